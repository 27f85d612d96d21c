// Memory is handed out from below and taken back by going back to a mark.

const ALIGNMENT: usize = 16;
/** Bytes behind each piece that vectors may read and write. */
const SLACK: usize = 64;

let top: usize = (__heap_base + ALIGNMENT) & ~(ALIGNMENT - 1);

/** The end of what is in use. */
export function mark(): usize {
  return top;
}

/** Take back what has been handed out since a mark. */
export function release(to: usize): void {
  top = to;
}

/** So many bytes, whatever is in them. */
export function allocate(bytes: usize): usize {
  const at = top;
  top = (top + bytes + SLACK + ALIGNMENT) & ~(ALIGNMENT - 1);
  const missing = <i32>((top + 0xffff) >> 16) - memory.size();
  if (missing > 0 && memory.grow(missing) < 0) unreachable();
  return at;
}

/** So many zeros. */
export function allocateZeros(bytes: usize): usize {
  const at = allocate(bytes);
  memory.fill(at, 0, bytes + SLACK);
  return at;
}
