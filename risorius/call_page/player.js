const OTHER = 1,
  SELF = 2,
  CAMERA = 3,
  VOICE = 4,
  MICROPHONE = 5,
  HEADER_BYTES = 24,
  // What is added to a stream: its face, its model.
  FACE = 64,
  MODEL = 128;
// Pictures that wait for their time at most: more come only while the page is not drawn.
const MAX_QUEUED = 90;
// Pictures that wait to be decoded at most, and how many of the newest stay then: what is left out costs nothing.
const MAX_CODED = 24,
  KEPT_CODED = 8;
// For so long it is said that this computer is too slow.
const SLOW_S = 5;
const MARGIN_S = 0.004;
// A picture is drawn before the frame of the screen that is next to its time.
const HALF_FRAME_S = 0.008;
const now = () => performance.now() / 1000;

// Shows pictures at the distances at which they were taken.  They come in groups, a packet at a time.
/** What draws faces: `player/page/face_drawer.js`.
 * @typedef {{addModel: (message: ArrayBuffer) => void,
 *   draw: (face: object) => HTMLCanvasElement | null}} FaceDrawer */
/** How late pictures are shown: `player/playout/playout_delay.js`.
 * @typedef {{offset: number | null, reset: () => void,
 *   arrived: (timeS: number, nowS: number, marginS: number) => boolean}} PlayoutDelay */
/** What the script `face_drawer.js` gives.
 * @type {{canDraw: (isForced: boolean) => boolean, make: (data: ArrayBuffer, kept?: number) => FaceDrawer,
 *   parse: (data: ArrayBuffer, start: number) => object, PlayoutDelay: new () => PlayoutDelay}} */
// @ts-expect-error: that script is built
const faces = window.faces;
/** A picture as it has come.  jpeg: its file; bitmap: decoded; face: instead of them.  time: in the source, seconds.
 * made, came: when it was taken and has come, ms since 1970.  waited: at the other end, ms.
 * frozen: 0, 1: no face is in the picture, 2: nothing comes.
 * @typedef {{frozen: number, index: number, time: number, made: number, waited: number,
 *   came: number, jpeg?: Uint8Array<ArrayBuffer>, face?: object, bitmap?: ImageBitmap}} Picture */

class Player {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = this.flat = canvas;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    /** @type {Picture[]} */
    this.queue = [];
    this.shown = 0;
    this.index = -1;
    /** @type {number[][]} */
    this.log = [];
    /** @type {Picture[]} */
    this.coded = [];
    this.frozen = 0;
    /** @type {number | undefined} */
    this.wait = undefined;
    this.delay = new faces.PlayoutDelay();
    this.isDecoding = false;
    this.leftOut = 0;
    this.slowAt = -Infinity;
    /** @type {FaceDrawer | null} null: faces do not come */
    this.drawer = null;
    /** @type {Picture | undefined} a face whose model is still being decoded */
    this.due = undefined;
  }
  /** From the time in the source to that of the page, seconds; null: not known yet. */
  get offset() {
    return this.delay.offset;
  }
  set offset(offset) {
    this.delay.offset = offset;
  }
  reset() {
    this.delay.reset();
    this.clear();
  }
  clear() {
    this.due = undefined;
    this.drop(this.queue.length);
  }
  /** @param {number} count */
  drop(count) {
    for (const picture of this.queue.splice(0, count)) picture.bitmap?.close();
  }
  /** What comes now has this time in the source, and can be shown so much later, seconds.
   * @param {number} time
   * @param {number} margin */
  arrived(time, margin) {
    if (this.delay.arrived(time, now(), margin)) this.clear();
  }
  /** Takes a picture that is not decoded.  One after the other: two may be ready in another order.
   * @param {Picture} picture */
  async receive(picture) {
    if (picture.face) return this.add(picture);
    this.coded.push(picture);
    if (this.coded.length > MAX_CODED) {
      this.leftOut += this.coded.splice(0, this.coded.length - KEPT_CODED).length;
      this.slowAt = now();
    }
    if (this.isDecoding) return;
    this.isDecoding = true;
    for (let next = this.coded.shift(); next; next = this.coded.shift()) {
      try {
        const jpeg = /** @type {Uint8Array<ArrayBuffer>} */ (next.jpeg);
        next.bitmap = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
        this.add(next);
      } catch {
        /* It is no picture. */
      }
    }
    this.isDecoding = false;
  }
  get isSlow() {
    return now() - this.slowAt < SLOW_S;
  }
  /** @param {Picture} picture */
  add(picture) {
    this.arrived(picture.time, MARGIN_S);
    this.queue.push(picture);
    if (this.queue.length > MAX_QUEUED) this.drop(this.queue.length - MAX_QUEUED);
  }
  /** Show a canvas in the place of the one before.
   * @param {HTMLCanvasElement} canvas */
  use(canvas) {
    if (this.canvas === canvas) return;
    for (const name of ["id", "role", "aria-label"]) {
      canvas.setAttribute(name, this.canvas.getAttribute(name) ?? "");
    }
    canvas.hidden = this.canvas.hidden;
    this.canvas.removeAttribute("id");
    this.canvas.replaceWith(canvas);
    this.canvas = canvas;
  }
  /** Draw a face here; whether its model is there.
   * @param {Picture} picture */
  drawFace(picture) {
    const drawn = picture.face ? this.drawer?.draw(picture.face) : null;
    if (!drawn) return false;
    this.use(drawn);
    // What is lost is shown in grey; a picture that the program has drawn is so already.
    drawn.style.filter = picture.frozen === 2 ? "grayscale(1)" : "";
    return true;
  }
  /** Show a picture that the program has drawn.
   * @param {Picture} picture */
  drawBitmap({ bitmap }) {
    if (!bitmap) return false;
    this.use(this.flat);
    const { width, height } = bitmap;
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    this.context.drawImage(bitmap, 0, 0);
    bitmap.close();
    return true;
  }
  tick() {
    const at = now();
    let due = 0;
    while (
      due < this.queue.length &&
      this.queue[due].time + (this.offset ?? 0) <= at + HALF_FRAME_S
    )
      due++;
    if (due) {
      this.drop(due - 1);
      this.due = this.queue.shift();
    }
    const picture = this.due;
    if (!picture || !(picture.face ? this.drawFace(picture) : this.drawBitmap(picture))) return;
    this.due = undefined;
    this.shown++;
    this.index = picture.index;
    this.frozen = picture.frozen;
    this.wait = Date.now() - picture.made;
    this.log.push([
      picture.index,
      performance.timeOrigin + performance.now(),
      picture.made,
      picture.waited,
      picture.came,
    ]);
    if (this.log.length > 4000) this.log.shift();
  }
}
const players = { [OTHER]: new Player(el("other")), [SELF]: new Player(el("self")) };
