/**
 * An element of the page.
 * @template {HTMLElement} T
 * @param {string} id
 * @param {new () => T} Type
 */
export function element(id, Type) {
  const found = document.getElementById(id);
  if (!(found instanceof Type)) throw new Error(`the page has no ${id}`);
  return found;
}

/** Let the button `full` switch to full screen and back; what does so as well. */
export function fullScreenSwitch() {
  const full = element("full", HTMLButtonElement);
  const toggle = () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else
      element("screen", HTMLElement)
        .requestFullscreen()
        .catch(() => {});
  };
  full.hidden = !document.fullscreenEnabled;
  full.onclick = toggle;
  return toggle;
}
