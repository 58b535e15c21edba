/** Compiled design evaluator (native/src/designs) as WebAssembly, built by native/wasm/build.sh. */

/** Design with an ideal lens, input of the evaluator. Lengths in mm. */
export interface Ideal {
  rim: number;
  /** Distance from lens to vertex; 1 (unused) for telecentric lenses. */
  distance: number;
  focalLength: number;
  fNumber: number;
  /** Positive for telecentric lenses only. */
  magnification: number;
  pitch: number;
  /** Vertex radius and conic constant of conic mirrors. */
  conic: { radius: number; constant: number } | null;
  /** Coefficients of u^(2i), i from `first`, where u is the fraction of the rim radius, in rim radii. */
  coefficients: number[];
  first: number;
}

/** Properties of the mirror at fractions of its rim radius. */
export interface Columns {
  omega_deg: Float64Array;
  h_px: Float64Array;
  dh_domega_px_per_deg: Float64Array;
  width_px_per_deg: Float64Array;
  viewpoint_z_mm: Float64Array;
  distance_t_mm: Float64Array;
  distance_s_mm: Float64Array;
  blur_t_px: Float64Array;
  blur_s_px: Float64Array;
  floored_area_deg2: Float64Array;
  z_mm: Float64Array;
  focus: number;
  isUsable: boolean;
}

interface Exports {
  memory: WebAssembly.Memory;
  _initialize: () => void;
  room: (count: number) => number;
  design: (...numbers: number[]) => void;
}

const NAMES = [
  "omega_deg",
  "h_px",
  "dh_domega_px_per_deg",
  "width_px_per_deg",
  "viewpoint_z_mm",
  "distance_t_mm",
  "distance_s_mm",
  "blur_t_px",
  "blur_s_px",
  "floored_area_deg2",
  "z_mm",
] as const;
const MAX_ANGLES = 400;
const MAX_TERMS = 16;
const ROOM = {
  coefficients: MAX_TERMS,
  numbers: 7,
  basis: 3 * MAX_TERMS * MAX_ANGLES,
  fractions: MAX_ANGLES,
  near: MAX_ANGLES,
  search: 6,
  columns: NAMES.length * MAX_ANGLES,
  results: 2,
};
type Name = keyof typeof ROOM;

/** Evaluator, from its base64 bytes; `search` configures the focus search (optics/batch/best_focus.py). */
export class Kernel {
  private readonly exports: Exports;
  private readonly places: Record<Name, number>;

  constructor(compiled: string, search: readonly number[]) {
    const bytes = Uint8Array.from(atob(compiled), (c) => c.charCodeAt(0));
    const silent = { fd_close: () => 0, fd_seek: () => 0, fd_write: () => 0 }; // library output is discarded
    this.exports = new WebAssembly.Instance(new WebAssembly.Module(bytes), {
      wasi_snapshot_preview1: silent,
    }).exports as unknown as Exports;
    this.exports._initialize();
    this.places = Object.fromEntries(
      Object.entries(ROOM).map(([name, count]) => [name, this.exports.room(count)]),
    ) as Record<Name, number>;
    this.write("search", search);
  }

  /** Evaluate a design with a given focus distance (null: minimum of the maximum floored area) and object distance (null: infinite). */
  evaluate(
    ideal: Ideal,
    fractions: ArrayLike<number>,
    object: number | null,
    focus: number | null,
  ): Columns {
    const { rim, conic, coefficients, pitch } = ideal;
    const count = fractions.length;
    const terms = coefficients.length;
    this.write("coefficients", coefficients);
    this.write("numbers", [
      ideal.distance,
      rim,
      ideal.focalLength,
      ideal.fNumber,
      conic?.radius ?? 1,
      conic?.constant ?? 0,
      ideal.magnification,
    ]);
    this.write("basis", basis(ideal, fractions));
    this.write("fractions", fractions);
    this.write(
      "near",
      Array.from(fractions, () => (object === null ? 0 : 1 / object)),
    );
    const p = this.places;
    this.exports.design(
      p.coefficients,
      p.numbers,
      p.basis,
      p.fractions,
      p.near,
      p.search,
      terms,
      count,
      Number(conic !== null),
      pitch,
      WAVELENGTH_NM,
      focus ?? NaN,
      p.columns,
      p.results,
    );
    const columns = NAMES.map((name, i) => [name, this.read("columns", i * count, count)]);
    const [result, isUsable] = this.read("results", 0, ROOM.results);
    return { ...Object.fromEntries(columns), focus: result, isUsable: isUsable > 0 } as Columns;
  }

  private write(name: Name, values: ArrayLike<number>): void {
    if (values.length > ROOM[name])
      throw new RangeError(
        `${values.length} numbers exceed the capacity of ${name}, ${ROOM[name]}`,
      );
    new Float64Array(this.exports.memory.buffer, this.places[name], values.length).set(values);
  }

  private read(name: Name, first: number, count: number): Float64Array {
    return new Float64Array(
      this.exports.memory.buffer,
      this.places[name] + 8 * first,
      count,
    ).slice();
  }
}

/** Diameter of the Airy disk. */
export const WAVELENGTH_NM = 550;

/** Compute sag, slope and curvature of each term at each fraction (optics/batch/families.py). */
function basis({ coefficients, first }: Ideal, fractions: ArrayLike<number>): number[] {
  const rows = (of: (u: number, n: number) => number): number[] =>
    coefficients.flatMap((_, i) => Array.from(fractions, (u) => of(u, 2 * (first + i))));
  return [
    ...rows((u, n) => u ** n),
    ...rows((u, n) => n * u ** (n - 1)),
    ...rows((u, n) => n * (n - 1) * u ** (n - 2)),
  ];
}
