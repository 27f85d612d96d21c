// A recorded call: what has come stays here, so that it can be stopped, gone through and played again, also when its
// program has ended.  Until somebody touches it, it is shown as it comes.
const SOUND_AHEAD_S = 0.4;
const tape = {
  is: false,
  isTouched: false,
  isPlaying: true,
  /** @type {Picture[]} */
  pictures: [],
  /** @type {{time: number, samples: Float32Array}[]} */
  sounds: [],
  place: 0,
  from: 0,
  at: 0,
  shown: -1,
  heard: 0,
  isDrawing: false,
  get end() {
    return this.pictures.length ? this.pictures[this.pictures.length - 1].time : 0;
  },
  /** @param {Picture} picture */
  add(picture) {
    this.pictures.push(picture);
  },
  /** The first item at or after a time.
   * @param {{time: number}[]} items
   * @param {number} time */
  find(items, time) {
    let low = 0,
      high = items.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (items[middle].time < time) low = middle + 1;
      else high = middle;
    }
    return low;
  },
  /** Go to a place, seconds.
   * @param {number} place
   * @param {boolean} isPlaying */
  touch(place, isPlaying) {
    if (!this.isTouched) players[OTHER].reset();
    this.isTouched = true;
    this.isPlaying = isPlaying;
    this.from = this.place = Math.max(0, Math.min(place, this.end));
    this.at = now();
    this.shown = -1;
    this.heard = this.find(this.sounds, this.place);
  },
  toggle() {
    const place = this.current;
    if (this.isTouched ? this.isPlaying : place < this.end || !ended)
      return this.touch(place, false);
    this.touch(place >= this.end - 0.05 ? 0 : place, true);
  },
  get shownLive() {
    const index = players[OTHER].index,
      picture = this.pictures.find((each) => each.index === index);
    return picture ? picture.time : this.end;
  },
  get current() {
    return this.isTouched ? this.place : this.shownLive;
  },
  get hasEnded() {
    return this.isTouched ? !this.isPlaying : ended && !players[OTHER].queue.length;
  },
  tick() {
    if (!this.is) return;
    if (this.isTouched && this.isPlaying) {
      this.place = this.from + now() - this.at;
      players[OTHER].offset = this.at - this.from;
      if (this.place >= this.end && ended) {
        this.place = this.end;
        this.isPlaying = false;
      }
      for (
        ;
        this.heard < this.sounds.length &&
        this.sounds[this.heard].time < this.place + SOUND_AHEAD_S;
        this.heard++
      ) {
        const { time, samples } = this.sounds[this.heard];
        if (voice.node) voice.node.port.postMessage({ time, samples });
      }
    }
    if (this.isTouched) this.draw(Math.max(0, this.find(this.pictures, this.place + 0.001) - 1));
    const place = this.current,
      isPlaying = !this.hasEnded;
    el("place").max = this.end;
    if (document.activeElement !== el("place") || this.isPlaying) el("place").value = place;
    el("play").textContent = isPlaying ? "❚❚" : "▶";
    el("play").setAttribute(
      "aria-label",
      isPlaying ? "Pause" : place >= this.end - 0.05 ? "Play again" : "Play",
    );
    el("clock").textContent = `${clockText(place)} / ${clockText(this.end)}`;
  },
  /** @param {number} number */
  async draw(number) {
    const picture = this.pictures[number],
      player = players[OTHER];
    if (!picture || this.isDrawing || number === this.shown) return;
    if (picture.face) {
      if (!player.drawFace(picture)) return;
      player.index = picture.index;
      player.frozen = picture.frozen;
      this.shown = number;
      return;
    }
    this.isDrawing = true;
    try {
      const bitmap = await createImageBitmap(
        new Blob([/** @type {Uint8Array<ArrayBuffer>} */ (picture.jpeg)], { type: "image/jpeg" }),
      );
      player.drawBitmap({ ...picture, bitmap });
      player.index = picture.index;
      player.frozen = picture.frozen;
      this.shown = number;
    } catch {
      /* It is no picture. */
    }
    this.isDrawing = false;
  },
};
/** @param {number} time */
const clockText = (time) =>
  `${Math.floor(time / 60)}:${String(Math.floor(time % 60)).padStart(2, "0")}`;
el("play").onclick = () => tape.toggle();
el("place").oninput = () =>
  tape.touch(Number(el("place").value), tape.isTouched ? tape.isPlaying : !ended);
