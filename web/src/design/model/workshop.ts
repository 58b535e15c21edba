/** Workshop data of drawings: title block, and specification of each mirror. */
import type { WorkshopEntry } from "../../shared/messages";
import { load, locals, parsed, put } from "../../shared/storage";

export type Workshop = Record<string, Record<string, string | number | null>>;

const KEY = "omnimirror-workshop";

/** Return the value of a filled field; null for an empty number, which has its default. */
export function entered(
  { max_length }: Pick<WorkshopEntry, "max_length">,
  text: string,
): string | number | null {
  if (max_length !== null) return text.trim();
  return text === "" ? null : Number(text);
}

/** Return the data of a stored text; entries of other types are omitted. */
export function workshopOf(text: string | null): Workshop {
  const data = parsed(text ?? "{}");
  const isTable = (value: unknown): value is Record<string, unknown> =>
    typeof value === "object" && value !== null && !Array.isArray(value);
  if (!isTable(data)) return {};
  const isValue = ([, value]: [string, unknown]): boolean =>
    value === null || typeof value === "string" || Number.isFinite(value);
  return Object.fromEntries(
    Object.entries(data)
      .filter(([, section]) => isTable(section))
      .map(([name, section]) => [
        name,
        Object.fromEntries(Object.entries(section as object).filter(isValue)) as Workshop[string],
      ]),
  );
}

export const storedWorkshop = (): string | null => load(locals, KEY);
export const storeWorkshop = (workshop: Workshop): void =>
  put([locals], KEY, JSON.stringify(workshop));
