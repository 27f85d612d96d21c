// Lids that close by themselves now and then, on top of what the sliders say.
const BLINK = { close: 90, closed: 40, open: 170, least: 2000, most: 6000 }; // ms
let blinkTimer = 0,
  blinkClosure = 0; // 0..1

function smooth(t) {
  return t * t * (3 - 2 * t);
}
/** How far the lids are closed, 0..1, so many ms after a blink has begun. */
function closureAt(ms) {
  const { close, closed, open } = BLINK;
  if (ms < close) return smooth(ms / close);
  if (ms < close + closed) return 1;
  return 1 - smooth(Math.min((ms - close - closed) / open, 1));
}
/** What is asked for, with the lids at least as far closed as the blink has them. */
function withBlink(values) {
  if (!blinkClosure) return values;
  const lids = ["lid_left", "lid_right"].map((name) => [
    name,
    Math.max(values[name] || 0, blinkClosure),
  ]);
  return { ...values, ...Object.fromEntries(lids) };
}
function setBlinking(on, draw) {
  clearTimeout(blinkTimer);
  blinkTimer = 0;
  if (on) nextBlink(draw, BLINK.least / 4);
}
function nextBlink(draw, wait) {
  blinkTimer = window.setTimeout(() => {
    const began = performance.now();
    const step = (now) => {
      const ms = Math.max(now - began, 0);
      blinkClosure = closureAt(ms);
      draw();
      if (blinkClosure || ms < BLINK.close) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
    nextBlink(draw, BLINK.least + Math.random() * (BLINK.most - BLINK.least));
  }, wait);
}
