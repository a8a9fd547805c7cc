// Power spectral density of a command that is held between samples, by Welch.

const SHORTEST = 64;
const LONGEST = 4096;
const SEGMENTS = 8;

/** In place: the discrete Fourier transform of a length that is a power of two. */
function transform(real, imaginary) {
  const n = real.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) {
      [real[i], real[j]] = [real[j], real[i]];
      [imaginary[i], imaginary[j]] = [imaginary[j], imaginary[i]];
    }
  }
  for (let size = 2; size <= n; size *= 2) {
    const half = size / 2;
    for (let k = 0; k < half; k++) {
      const [c, s] = [Math.cos((-2 * Math.PI * k) / size), Math.sin((-2 * Math.PI * k) / size)];
      for (let a = k; a < n; a += size) {
        const b = a + half;
        const [re, im] = [real[b] * c - imaginary[b] * s, real[b] * s + imaginary[b] * c];
        [real[b], imaginary[b]] = [real[a] - re, imaginary[a] - im];
        real[a] += re;
        imaginary[a] += im;
      }
    }
  }
}

/** Values on a grid of a rate [Hz], each held until the next one; what is no number is held over. */
function on_grid(time, values, a, b, rate) {
  while (a < b && Number.isNaN(values[a])) a += 1;
  if (a >= b) return new Float64Array(0);
  const size = Math.round((time[b - 1] - time[a]) * rate) + 1;
  const grid = new Float64Array(size);
  let [row, held] = [a, values[a]];
  for (let k = 0; k < size; k++) {
    while (row < b && time[row] <= time[a] + (k + 0.5) / rate) {
      if (!Number.isNaN(values[row])) held = values[row];
      row += 1;
    }
    grid[k] = held;
  }
  return grid;
}

/** Frequencies [rad/s] and the one-sided density [unit squared per rad/s] of rows a to b, or null. */
export function density(time, values, a, b, rate) {
  const grid = on_grid(time, values, a, b, rate);
  if (grid.length < SHORTEST) return null;
  let n = SHORTEST;
  while (2 * n <= Math.min(LONGEST, (2 * grid.length) / (SEGMENTS + 1))) n *= 2;
  const window = Float64Array.from({ length: n }, (_, k) => 0.5 - 0.5 * Math.cos((2 * Math.PI * k) / n));
  const power = window.reduce((sum, w) => sum + w * w, 0);
  const sum = new Float64Array(n / 2);
  let count = 0;
  for (let start = 0; start + n <= grid.length; start += n / 2) {
    const part = grid.subarray(start, start + n);
    const mean = part.reduce((total, value) => total + value, 0) / n;
    const real = part.map((value, k) => (value - mean) * window[k]);
    const imaginary = new Float64Array(n);
    transform(real, imaginary);
    for (let k = 0; k < n / 2; k++) sum[k] += real[k] ** 2 + imaginary[k] ** 2;
    count += 1;
  }
  const [x, y] = [[], []];
  for (let k = 1; k < n / 2; k++) {
    x.push((2 * Math.PI * k * rate) / n);
    y.push((2 * sum[k]) / (count * rate * power) / (2 * Math.PI));
  }
  return { x, y };
}
