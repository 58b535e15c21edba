import type { DesignStart, ParameterInfo, PartInfo } from "../../shared/messages";
import type { Design, Tables } from "./design";

type Parts = Pick<
  DesignStart,
  "mirrors" | "secondaries" | "lenses" | "imager" | "secondary_position" | "quantities"
>;

/** Return the reason for which a text or object is not a valid design; null if it is valid. */
export function lacking(result: unknown, parts: Parts): string | null {
  if (!isTable(result)) return "it must be a design";
  if (!isTable(result.tables)) return "it must contain the tables of a sensor";
  if (!isNumberOrNull(result.distance))
    return `the object distance must be positive; got ${short(result.distance)}`;
  return (
    ofSensor(result.tables, result.follows_mapping === true, parts) ??
    ofRequirements(result.requirements ?? null, parts)
  );
}

/** Convert a valid object to a design. */
export const designOf = (result: Tables): Design => ({
  tables: result.tables as Tables,
  follows_mapping: result.follows_mapping === true,
  distance: (result.distance as number | null | undefined) ?? null,
  requirements: (result.requirements as Tables | null | undefined) ?? null,
});

function ofSensor(tables: Tables, follows: boolean, parts: Parts): string | null {
  for (const name of ["mirror", "lens", "imager"])
    if (!isTable(tables[name])) return `[${name}] is missing`;
  if (!isTable(tables.mount ?? {})) return `mount must be a table; got ${short(tables.mount)}`;
  if (tables.name !== undefined && typeof tables.name !== "string")
    return `name must be a text; got ${short(tables.name)}`;
  const distance = (tables.mount as Tables | undefined)?.mirror_distance_mm as unknown;
  if (!isNumberOrNull(distance))
    return `mount.mirror_distance_mm must be a number; got ${short(distance)}`;
  if (tables.lens.kind === "perspective" && !follows && typeof distance !== "number")
    return "mount.mirror_distance_mm is missing";
  const kinds: [string, PartInfo[]][] = [
    ["mirror", parts.mirrors],
    ["lens", parts.lenses],
  ];
  const pose = tables.mirror_pose as unknown;
  if (
    pose !== undefined &&
    !(isTable(pose) && Object.values(pose).every((v) => Number.isFinite(v)))
  )
    return "mirror_pose must be a table of numbers";
  if (tables.secondary !== undefined) kinds.push(["secondary", parts.secondaries]);
  for (const [name, known] of kinds) {
    const part = isTable(tables[name])
      ? known.find((p) => p.kind === tables[name].kind)
      : undefined;
    const problem = part
      ? ofPart(name, part, tables[name] as Tables)
      : `${name}.kind must be one of ${known.map((p) => p.kind).join(", ")}`;
    if (problem) return problem;
  }
  return (
    ofPart("imager", parts.imager, tables.imager as Tables) ??
    (tables.secondary
      ? ofPart("secondary", parts.secondary_position, tables.secondary as Tables)
      : null)
  );
}

function ofPart(section: string, part: PartInfo, table: Tables): string | null {
  for (const p of part.parameters) {
    const value = table[p.name] as unknown;
    if (value === undefined || value === null) {
      if (!p.is_optional) return `${section}.${p.name} is missing`;
    } else if (!isOf(p, value))
      return `${section}.${p.name} must be a ${p.choices.length ? "choice" : p.is_list ? "list of numbers" : "number"}; got ${short(value)}`;
  }
  return null;
}

function isOf(p: ParameterInfo, value: unknown): boolean {
  if (p.choices.length) return p.choices.includes(value as string);
  if (p.is_list) return Array.isArray(value) && value.every((v) => Number.isFinite(v));
  return Number.isFinite(value);
}

function ofRequirements(requirements: unknown, parts: Parts): string | null {
  if (requirements === null) return null;
  if (!isTable(requirements) || !isTable(requirements.field))
    return "[field] of the requirements is missing";
  if (!Number.isFinite(requirements.field.omega_max_deg))
    return "field.omega_max_deg of the requirements is missing";
  const limits = (requirements.limit ?? []) as unknown;
  if (!Array.isArray(limits)) return "the limits of the requirements must be a list";
  const unknown = limits.find(
    (l) => !isTable(l) || !parts.quantities.some((q) => q.name === l.quantity),
  ) as unknown;
  return unknown === undefined
    ? null
    : `the requirements contain an unknown quantity, ${short(isTable(unknown) ? unknown.quantity : unknown)}`;
}

const isTable = (value: unknown): value is Tables =>
  typeof value === "object" && value !== null && !Array.isArray(value);
const isNumberOrNull = (value: unknown): boolean =>
  value === undefined || value === null || Number.isFinite(value);
const short = (value: unknown): string => (JSON.stringify(value) ?? "nothing").slice(0, 40);
