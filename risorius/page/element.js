// What the scripts of all pages use.

/** The element of an id, of whatever kind it is in the page.
 * @param {string} id
 * @returns {any} */
const el = (id) => document.getElementById(id);
