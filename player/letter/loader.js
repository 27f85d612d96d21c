// Starts a letter: takes its parts out of the page.  Not a module, and small: it is not compressed.
(async () => {
  const message = /** @type {HTMLElement} */ (document.getElementById("message"));
  // RFC 1924's digits, other ones for < and &: four bytes are five of them, the highest first.
  const alphabet =
    "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%,()*+-;/=>?@^_`{|}~";
  const digits = new Uint8Array(128);
  for (let i = 0; i < alphabet.length; i++) digits[alphabet.charCodeAt(i)] = i;
  const bytes = (/** @type {string} */ id) => {
    const text = document.getElementById(id)?.textContent ?? "";
    const groups = Math.ceil(text.length / 5);
    const all = new DataView(new ArrayBuffer(4 * groups));
    for (let i = 0; i < groups; i++) {
      let value = 0;
      for (let k = 5 * i; k < 5 * i + 5; k++)
        value = 85 * value + (k < text.length ? digits[text.charCodeAt(k)] : 84);
      all.setUint32(4 * i, value);
    }
    return new Uint8Array(all.buffer, 0, 4 * groups - (5 * groups - text.length));
  };
  const inflated = (/** @type {string} */ id) =>
    new Response(
      new Blob([bytes(id)]).stream().pipeThrough(new DecompressionStream("deflate")),
    ).arrayBuffer();
  try {
    const [player, data] = await Promise.all([inflated("player"), inflated("data")]);
    const script = URL.createObjectURL(new Blob([player], { type: "text/javascript" }));
    const start = document.createElement("script");
    start.src = script;
    start.onload = () =>
      /** @type {any} */ (window).openLetter({
        script,
        data,
        call: bytes("call"),
        sound: bytes("sound"),
      });
    document.body.append(start);
  } catch (error) {
    console.error(error);
    message.textContent = "This browser is too old for the letter.";
  }
})();
