/** Input of the evaluator from the tables of a sensor file; unsupported entries raise an error. */
import { RequestRejected } from "../../shared/api";
import type { DesignStart, ParameterInfo, PartInfo } from "../../shared/messages";
import type { Tables } from "../model/design";
import type { Ideal } from "./kernel";

/** Error with the entry that it concerns. */
export class InvalidDesign extends RequestRejected {
  constructor(
    readonly path: string[],
    message: string,
  ) {
    super(message);
  }
}

type Sections = Record<string, Tables>;
type Mirror = Pick<Ideal, "conic" | "coefficients" | "first">;

const number = (table: Tables, name: string, other = NaN): number =>
  (table[name] as number | undefined) ?? other;
const bare = (radius: number, constant: number): Mirror => ({
  conic: { radius, constant },
  coefficients: [],
  first: 2,
});

/** Conversions of optics/mirrors/mirror.py. */
const MIRRORS: Record<string, (table: Tables) => Mirror> = {
  sphere: (t) => bare(number(t, "radius_mm"), 0),
  paraboloid: (t) => bare(number(t, "vertex_radius_mm"), -1),
  hyperboloid: (t) =>
    bare(
      number(t, "a_mm") ** 2 / number(t, "b_mm"),
      -1 - (number(t, "a_mm") / number(t, "b_mm")) ** 2,
    ),
  ellipsoid: (t) =>
    bare(
      number(t, "a_mm") ** 2 / number(t, "b_mm"),
      (number(t, "a_mm") / number(t, "b_mm")) ** 2 - 1,
    ),
  "conic-asphere": (t) => ({
    ...bare(number(t, "vertex_radius_mm"), number(t, "conic")),
    coefficients: ofRim(t, 2),
  }),
  "even-polynomial": (t) => ({ conic: null, coefficients: ofRim(t, 1), first: 1 }),
};

/** Convert coefficients of powers of x / N, in units of the normalisation radius N, to the rim radius M. */
function ofRim(table: Tables, first: number): number[] {
  const N = number(table, "normalization_radius_mm", 1);
  const M = number(table, "rim_radius_mm");
  return ((table.coefficients ?? []) as number[]).map(
    (c, i) => c * (M / N) ** (2 * (first + i) - 1),
  );
}

/** Return the input of the evaluator for a design; throws if a number is outside its valid range. */
export function idealOf(tables: Sections, parts: DesignStart): Ideal {
  const { mirror, lens, imager, mount } = tables;
  within("mirror", partOf("mirror", parts.mirrors, mirror), mirror);
  within("lens", partOf("lens", parts.lenses, lens), lens);
  within("imager", parts.imager, imager);
  const foreign = Object.keys(lens).find(
    (name) =>
      name !== "kind" &&
      lens[name] &&
      !parts.lenses.some(
        (part) => part.kind === lens.kind && part.parameters.some((p) => p.name === name),
      ),
  );
  if (foreign)
    throw new InvalidDesign(
      ["lens", foreign],
      `${foreign} = ${String(lens[foreign])}: this page runs without a server and supports ideal lenses only`,
    );
  const isTelecentric = lens.kind === "orthographic";
  if (!isTelecentric) within("mount", parts.mount, mount);
  const f = number(lens, "focal_length_mm", 1);
  if (!isTelecentric && number(lens, "focus_distance_mm") <= f)
    throw new InvalidDesign(
      ["lens", "focus_distance_mm"],
      `focus_distance_mm must be greater than focal_length_mm = ${f}; got ${number(lens, "focus_distance_mm")}`,
    );
  const ideal: Ideal = {
    rim: number(mirror, "rim_radius_mm"),
    distance: isTelecentric ? 1 : number(mount, "mirror_distance_mm"),
    focalLength: f,
    fNumber: number(lens, isTelecentric ? "working_f_number" : "f_number"),
    magnification: isTelecentric ? number(lens, "magnification") : 0,
    pitch: number(imager, "pixel_pitch_um") * 1e-3,
    ...MIRRORS[mirror.kind as string](mirror),
  };
  const end = reach(ideal);
  if (ideal.rim >= end)
    throw new InvalidDesign(
      ["mirror", "rim_radius_mm"],
      `rim_radius_mm must be less than ${+end.toPrecision(5)} mm, where the ${String(mirror.kind)} ends; got ${ideal.rim}`,
    );
  return ideal;
}

/** Return the maximum radius of a conic, mm. */
const reach = ({ conic }: Ideal): number =>
  conic && conic.constant > -1 ? conic.radius / Math.sqrt(1 + conic.constant) : Infinity;

function partOf(section: string, parts: PartInfo[], table: Tables): PartInfo {
  const result = parts.find((p) => p.kind === table.kind);
  if (!result)
    throw new InvalidDesign(
      [section, "kind"],
      `${section} ${String(table.kind)} requires a server; this page supports ${parts.map((p) => p.kind).join(", ")}`,
    );
  return result;
}

function within(section: string, part: PartInfo, table: Tables): void {
  for (const p of part.parameters) {
    const value = table[p.name];
    for (const v of Array.isArray(value) ? (value as number[]) : [value])
      if (typeof v === "number") check(section, p, v);
  }
}

/** Check a parameter against its valid range; the message is that of base/parameters.py. */
function check(section: string, { name, low, high, unit }: ParameterInfo, value: number): void {
  if (value >= low && value <= high) return;
  const of = unit ? ` ${unit}` : "";
  throw new InvalidDesign(
    [section, name],
    `${name} must be between ${low} and ${high}${of}; got ${value}`,
  );
}
