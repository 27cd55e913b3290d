// Tension's colour as a share of its limit, the same as in the 3D view.
const RAMP = [
  [0, 62, 104, 214], [0.12, 64, 150, 224], [0.4, 72, 196, 150], [0.72, 236, 180, 64], [1, 236, 62, 52],
];

/** Tension's colour, of its share of the limit. */
export function rampColour(share) {
  const after = Math.max(1, RAMP.findIndex(([stop]) => stop >= share));
  const [from, to] = [RAMP[after - 1], RAMP[after]];
  const part = (share - from[0]) / (to[0] - from[0]);
  return `rgb(${[1, 2, 3].map((i) => Math.round(from[i] + part * (to[i] - from[i]))).join(" ")})`;
}
