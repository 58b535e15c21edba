/** Field angle of the cursor of all plots. */
export class Cursor {
  omega: number | null = null;
  private readonly listeners: ((omega: number | null, from: unknown) => void)[] = [];

  listen(listener: (omega: number | null, from: unknown) => void): void {
    this.listeners.push(listener);
  }

  set(omega: number | null, from: unknown): void {
    if (omega === this.omega) return;
    this.omega = omega;
    for (const listener of this.listeners) listener(omega, from);
  }
}

/** Interpolate at x in a table with increasing abscissae; NaN outside. */
export function interpolated(places: Float32Array, values: Float32Array, x: number): number {
  const last = places.length - 1;
  const slack = 1e-4 * Math.abs(places[last]);
  if (!(x >= places[0] - slack && x <= places[last] + slack)) return NaN;
  let low = 0;
  let high = last;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (places[middle] <= x) low = middle;
    else high = middle;
  }
  const share = Math.min(1, Math.max(0, (x - places[low]) / (places[high] - places[low] || 1)));
  return values[low] + share * (values[high] - values[low]);
}
