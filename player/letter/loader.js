// Starts a letter: takes its parts out of the page.  Not a module, and small: it is not compressed.
(async () => {
  const message = /** @type {HTMLElement} */ (document.getElementById("message"));
  const bytes = (/** @type {string} */ id) => {
    const part = /** @type {HTMLElement} */ (document.getElementById(id));
    return Uint8Array.from(atob(part.textContent ?? ""), (each) => each.charCodeAt(0));
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
      /** @type {any} */ (window).openLetter({ script, data, call: bytes("call").buffer });
    document.body.append(start);
  } catch (error) {
    console.error(error);
    message.textContent = "This browser is too old for the letter.";
  }
})();
