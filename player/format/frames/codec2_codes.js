// How many symbols of each code of Codec2's mode 1200 have each length in bits, from 0 on, see
// docs/format.md, Voice.
export const VOICING = [0, 1, 0, 0, 4, 6, 3, 2];
export const PITCH_AND_ENERGY = [0, 0, 0, 0, 0, 0, 22, 25, 50, 115, 40, 4];
export const SPECTRUM = [0, 0, 0, 0, 0, 0, 0, 22, 84, 153, 163, 82, 8];
