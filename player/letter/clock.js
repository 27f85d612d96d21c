/** The time of a call that is played: of its sound, if it has one. */
export class PlayClock {
  /**
   * @param {number} durationS
   * @param {HTMLAudioElement | null} sound
   */
  constructor(durationS, sound) {
    this.durationS = durationS;
    this.sound = sound;
    this.isPlaying = false;
    this.loops = false;
    this.speed = 1;
    this.placeS = 0;
    /** when `placeS` was, by `performance.now` */
    this.sinceMs = 0;
  }

  /** The time to show, seconds from the first frame. */
  get timeS() {
    if (!this.isPlaying) return this.placeS;
    const passed = this.placeS + ((performance.now() - this.sinceMs) / 1000) * this.speed;
    // A sound that has ended, or that waits for its data, does not hold up the picture.
    const { sound } = this;
    const isHeard = sound && !sound.ended && sound.readyState > 2 && !sound.paused;
    return Math.min(isHeard ? sound.currentTime : passed, this.durationS);
  }

  /** Go on from here; from the start if this is the end. */
  play() {
    if (this.timeS >= this.durationS) this.placeS = 0;
    this.#goOn(this.placeS, true);
  }

  /** Stay here. */
  pause() {
    this.#goOn(this.timeS, false);
  }

  /** @param {number} timeS */
  seek(timeS) {
    this.#goOn(Math.min(Math.max(timeS, 0), this.durationS), this.isPlaying);
  }

  /** @param {number} speed */
  setSpeed(speed) {
    const { timeS } = this;
    this.speed = speed;
    if (this.sound) this.sound.playbackRate = speed;
    this.#goOn(timeS, this.isPlaying);
  }

  /** Loop or stop at the end; to be called as often as the time is asked for. */
  turnAround() {
    if (!this.isPlaying || this.timeS < this.durationS) return;
    if (this.loops) this.#goOn(0, true);
    else this.pause();
  }

  /**
   * @param {number} placeS
   * @param {boolean} isPlaying
   */
  #goOn(placeS, isPlaying) {
    this.placeS = placeS;
    this.isPlaying = isPlaying;
    this.sinceMs = performance.now();
    const { sound } = this;
    if (!sound) return;
    if (Math.abs(sound.currentTime - placeS) > 0.05) sound.currentTime = placeS;
    if (isPlaying) sound.play().catch(() => {});
    else sound.pause();
  }
}
