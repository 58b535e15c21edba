/** Evaluation of a design like apps/studio/_design_evaluation.py: curves, cross-section, squares. */
import type { DesignRequest, StandaloneDesign, DesignSummary } from "../../shared/messages";
import type { Tables } from "../model/design";
import type { Evaluation, Table } from "../evaluation";
import { idealOf, InvalidDesign } from "./ideal_lens";
import { type Columns, type Ideal, Kernel, WAVELENGTH_NM } from "./kernel";

const NODES = 361; // samples of a curve
const PROFILE = 121; // samples of a mirror profile, axis to rim
const IMAGE_NODES = 3; // stride of field angles for the curves of virtual images
const MARKS_DEG = 15;
const PARALLEL = 1e-12; // cosine of incidence below which a plane counts as edge-on
const NEAR_OBJECTS = 5; // distance, in rim radii
const TELECENTRIC_LENS = 2.5; // drawn position of a telecentric lens, in rim radii
const LENS_HALF_WIDTH = 0.18; // relative to the rim radius
const ROUNDS = 8; // initial spacing of the search for mirror points; each iteration refines by about 100
const NOT_AVAILABLE = "Optimisation requires the installed program.";

type Columned = Table & { columns: string[] };
type Places = Pick<Table, "name"> & { x: ArrayLike<number>; z: ArrayLike<number> };

/** Evaluation of designs without a server. */
export class LocalEvaluator {
  private readonly kernel: Kernel;

  constructor(private readonly data: StandaloneDesign) {
    this.kernel = new Kernel(data.kernel, data.search);
  }

  /** Return the response to a request; an invalid design yields an error message. */
  answer(ask: DesignRequest, request: number): Evaluation {
    try {
      return evaluation(ask, request, ...this.computed(ask));
    } catch (e) {
      if (!(e instanceof InvalidDesign)) throw e;
      return evaluation(ask, request, [], null, e);
    }
  }

  /** Return the distance that minimises the maximum floored area, mm. */
  bestFocus(tables: DesignRequest["tables"], object: number | null): number {
    const ideal = idealOf(tables, this.data.start);
    const best = this.kernel.evaluate(ideal, spread(0, 1, NODES), object, null);
    if (!best.isUsable) throw unusable();
    return best.focus;
  }

  private computed({
    tables,
    object_distance_mm,
    include_section,
    include_squares,
  }: DesignRequest): [Columned[], DesignSummary] {
    const ideal = idealOf(tables, this.data.start);
    const { focus_distance_mm: focus } = tables.lens;
    const at = (fractions: ArrayLike<number>, object = object_distance_mm): Columns =>
      this.kernel.evaluate(ideal, fractions, object, focus);
    const even = at(spread(0, 1, NODES));
    if (!even.isUsable || even.omega_deg.some((o, i) => i > 0 && !(o > even.omega_deg[i - 1])))
      throw unusable();
    const end = even.omega_deg.at(-1)!;
    const fractions = fractionsOf(spread(even.omega_deg[0], end, NODES), even.omega_deg, at);
    const angles = Array.from({ length: Math.floor(end / MARKS_DEG) + 1 }, (_, i) => i * MARKS_DEG);
    const marks = { fractions: fractionsOf(angles, even.omega_deg, at) };
    const curve = at(fractions);
    const mark = at(marks.fractions);
    const tablesOf = [curves("curves", ideal, fractions, curve, object_distance_mm)];
    const summary = factsOf(tables, ideal, curve);
    if (include_section) {
      const far = object_distance_mm === null ? curve : at(fractions, null);
      tablesOf.push(
        ...sectionOf(
          ideal,
          { fractions, far, near: at(fractions, NEAR_OBJECTS * ideal.rim) },
          { ...marks, mark },
          at(spread(0, 1, PROFILE)).z_mm,
          summary,
        ).map(places),
      );
    }
    if (include_squares)
      tablesOf.push(curves("squares", ideal, marks.fractions, mark, object_distance_mm));
    return [tablesOf, summary];
  }
}

const unusable = (): InvalidDesign =>
  new InvalidDesign(["mirror"], "the lens must image each field angle of the mirror exactly once");

const spread = (from: number, to: number, count: number): number[] =>
  Array.from({ length: count }, (_, i) => from + ((to - from) * i) / (count - 1));

/** Compute the fractions of the rim radius for the field angles: linear initial values, refined by the secant method. */
function fractionsOf(
  omega: readonly number[],
  even: Float64Array,
  at: (fractions: number[]) => Columns,
): number[] {
  const step = 1 / (even.length - 1);
  const cells = omega.map((o) =>
    Math.min(Math.max(even.findIndex((e) => e >= o) - 1, 0), even.length - 2),
  );
  const rates = cells.map((k) => (even[k + 1] - even[k]) / step);
  let fractions = omega.map((o, i) =>
    Math.min(step * cells[i] + (o - even[cells[i]]) / rates[i], 1),
  );
  for (let round = 0; round < ROUNDS; round++) {
    const value = at(fractions).omega_deg;
    fractions = fractions.map((u, i) =>
      Math.min(Math.max(u + (omega[i] - value[i]) / rates[i], 0), 1),
    );
  }
  return fractions;
}

function factsOf(tables: DesignRequest["tables"], ideal: Ideal, curve: Columns): DesignSummary {
  const { lens, mount, imager } = tables;
  const isTelecentric = ideal.magnification > 0;
  const { minimum, maximum } = {
    minimum: (values: number[]) => Math.min(...values),
    maximum: (values: number[]) => Math.max(...values),
  };
  const image = isTelecentric ? 1 : 1 / (1 - ideal.focalLength / lens.focus_distance_mm); // b0/f, Eq. 25
  const resolution = Array.from(curve.dh_domega_px_per_deg, (dh, i) =>
    Math.min(dh, curve.width_px_per_deg[i]),
  );
  const viewpoints = [...curve.viewpoint_z_mm];
  const top = curve.z_mm.reduce((a, b) => Math.max(a, b));
  return {
    name: tables.name,
    field_deg: [curve.omega_deg[0], curve.omega_deg.at(-1)!],
    rim_radius_mm: ideal.rim,
    rim_radius_px: curve.h_px.at(-1)!,
    imager_radius_px: inscribed(imager),
    mirror_distance_mm: isTelecentric ? null : mount.mirror_distance_mm,
    focus_mm: lens.focus_distance_mm,
    depth_of_field_mm: depthOfField(ideal, lens.focus_distance_mm),
    airy_px: (2.44e-6 * WAVELENGTH_NM * ideal.fNumber * image) / ideal.pitch,
    length_mm: top + (isTelecentric ? 0 : ideal.distance),
    viewpoint_spread_mm: maximum(viewpoints) - minimum(viewpoints),
    worst_blur_px: finite(maximum([...curve.blur_t_px, ...curve.blur_s_px].map(Math.abs))),
    worst_floored_area_deg2: finite(maximum([...curve.floored_area_deg2])),
    resolution_px_per_deg: [minimum(resolution), finite(maximum(resolution))],
    not_optimised: NOT_AVAILABLE,
  };
}

const finite = (value: number): number | null => (Number.isFinite(value) ? value : null);

/** Return the radius of the largest inscribed circle about the axis, px. */
function inscribed({ width_px: w, height_px: h, centre_px: centre }: Tables): number {
  const [u, v] = (centre as [number, number] | undefined) ?? [(w - 1) / 2, (h - 1) / 2];
  return Math.min(u, v, w - 1 - u, h - 1 - v) + 0.5;
}

/** Compute the depth of field: distances at which the blur is one pixel, mm (Eqs. 30, 31). */
function depthOfField(
  { focalLength: f, fNumber: F, magnification: mu, pitch }: Ideal,
  focus: number,
): [number, number | null] {
  if (mu > 0) return [focus - (pitch * F) / mu ** 2, focus + (pitch * F) / mu ** 2];
  const spread = pitch * F * (focus - f);
  return [
    (f ** 2 * focus) / (f ** 2 + spread),
    spread < f ** 2 ? (f ** 2 * focus) / (f ** 2 - spread) : null,
  ];
}

// -- cross-section --------------------------------------------------------------------------------

interface Field {
  fractions: number[];
  far: Columns;
  near: Columns;
}

/** Compute mirror, lens, chief rays, virtual images and depth of field in the mirror frame, like analysis/cross_section.py. */
function sectionOf(
  ideal: Ideal,
  field: Field,
  marks: { fractions: number[]; mark: Columns },
  profile: Float64Array,
  { depth_of_field_mm, focus_mm }: DesignSummary,
): Places[] {
  const { rim } = ideal;
  const isTelecentric = ideal.magnification > 0;
  const lens = isTelecentric ? -TELECENTRIC_LENS * rim : -ideal.distance;
  const half = isTelecentric ? rim : LENS_HALF_WIDTH * rim;
  const zero = isTelecentric ? 0 : -ideal.distance;
  const mirror = {
    name: "mirror",
    x: spread(-rim, rim, 2 * PROFILE - 1),
    z: [...[...profile].reverse(), ...profile.subarray(1)],
  };
  const rays = marks.fractions.map((u, i) => ({
    name: `ray ${Math.round(marks.mark.omega_deg[i])}`,
    x: [u * rim, isTelecentric ? u * rim : 0],
    z: [marks.mark.z_mm[i], lens],
  }));
  const virtualImage = (name: string, distance: Float64Array, z: Float64Array): Places => {
    const some = field.fractions.flatMap((u, i) =>
      i % IMAGE_NODES ? [] : [{ u, far: distance[i], z: z[i] }],
    );
    const isServerAvailable = some.map((p) => Number.isFinite(p.far));
    return {
      name,
      x: some.map((p, i) =>
        !isServerAvailable[i]
          ? NaN
          : isTelecentric
            ? p.u * rim
            : (p.far * p.u * rim) / (ideal.distance + p.z),
      ),
      z: some.map((p, i) => (isServerAvailable[i] ? p.far + zero : NaN)),
    };
  };
  const { far, near } = field;
  const [nearest, farthest] = depth_of_field_mm;
  return [
    mirror,
    { name: "lens", x: [-half, half], z: [lens, lens] },
    ...rays,
    virtualImage("T∞", far.distance_t_mm, far.z_mm),
    virtualImage(`T${NEAR_OBJECTS}M`, near.distance_t_mm, near.z_mm),
    virtualImage("S∞", far.distance_s_mm, far.z_mm),
    virtualImage(`S${NEAR_OBJECTS}M`, near.distance_s_mm, near.z_mm),
    {
      name: "focus",
      x: [0, 0, 0],
      z: [focus_mm, nearest, farthest ?? Infinity].map((z) => z + zero),
    },
  ];
}

// -- tables ---------------------------------------------------------------------------------------

const places = ({ name, x, z }: Places): Columned => tableOf(name, { x_mm: x, z_mm: z });

/** Return the columns of Evaluation that are plotted. */
function curves(
  name: string,
  { rim }: Ideal,
  fractions: readonly number[],
  c: Columns,
  object: number | null,
): Columned {
  const across = ((object ?? Infinity) * Math.PI) / 180; // width of one degree at the object, perpendicular to the ray, mm
  const omega = (i: number): number => (c.omega_deg[i] * Math.PI) / 180;
  const per = (of: (i: number) => number): number[] => fractions.map((_, i) => of(i));
  const { dh_domega_px_per_deg: dh, width_px_per_deg: dw } = c;
  return tableOf(name, {
    omega_deg: c.omega_deg,
    x_mm: per((i) => fractions[i] * rim),
    z_mm: c.z_mm,
    h_px: c.h_px,
    dh_domega_px_per_deg: dh,
    width_px_per_deg: dw,
    viewpoint_z_mm: c.viewpoint_z_mm,
    area_px2: per((i) => dh[i] * dw[i]),
    aspect: per((i) => dw[i] / dh[i]),
    blur_t_px: c.blur_t_px,
    blur_s_px: c.blur_s_px,
    blur_t_deg: per((i) => c.blur_t_px[i] / dh[i]),
    blur_s_deg: per((i) => c.blur_s_px[i] / dw[i]),
    floored_area_deg2: c.floored_area_deg2,
    plane_t_mm_per_px: per((i) => {
      const cosine = Math.abs(Math.cos(omega(i)));
      return cosine < PARALLEL ? Infinity : across / dh[i] / cosine;
    }),
    cylinder_t_mm_per_px: per((i) => across / dh[i] / Math.sin(omega(i))),
    object_s_mm_per_px: per((i) => across / dw[i]),
  });
}

function tableOf(name: string, columns: Record<string, ArrayLike<number>>): Columned {
  const values = new Map(
    Object.entries(columns).map(([column, numbers]) => [column, Float32Array.from(numbers)]),
  );
  return {
    name,
    columns: [...values.keys()],
    rows: Object.values(columns)[0].length,
    column: (column) => values.get(column)!,
  };
}

function evaluation(
  ask: DesignRequest,
  request: number,
  tables: Columned[],
  summary: DesignSummary | null,
  error: InvalidDesign | null = null,
): Evaluation {
  const { slot, number } = ask;
  const blocks = tables.map(({ name, rows, columns }) => ({ name, rows, columns }));
  return {
    slot,
    number,
    request,
    summary,
    rows: [],
    note: null,
    requirements_error: null,
    blocks,
    edited: null,
    error: error && { path: error.path, message: error.message },
    block: (name) => tables.find((t) => t.name === name) ?? null,
  };
}
