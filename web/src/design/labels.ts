/** Displayed names of units, parameters and quantities. */
import type { QuantityInfo } from "../shared/messages";

const UNITS: Record<string, string> = {
  deg: "°",
  um: "µm",
  deg2: "deg²",
  "g/cm3": "g/cm³",
  "px/deg": "px/°",
};
export const unitWords = (unit: string): string => UNITS[unit] ?? unit;

/** Return the name of a parameter without its unit. */
export const label = (name: string): string => {
  const text = name.replace(/_(mm|um|deg|px)$/, "").replaceAll("_", " ");
  const labelled = text.replace(
    /^(omega|theta) (max|min)$/,
    (_, angle: string, end: string) => `${angle === "omega" ? "Ω" : "Θ"} ${end}`,
  );
  return labelled
    .replace(/^f number$/, "F-number")
    .replace(/^working f number$/, "working F-number")
    .replace(/^./, (c) => c.toUpperCase());
};

/** Internal name in a message: words joined by underscores, with an optional part such as "Mirror.". */
const INTERNAL = /(?<![\w.-])(?:[A-Za-z]+\.)?([a-z][a-z0-9]*(?:_[a-z0-9]+)+)(?![\w-])/g;

/** Return the message with the titles of quantities and the labels of parameters instead of internal names, and a capital. */
export const labelledMessage = (
  message: string,
  vocabulary: readonly Pick<QuantityInfo, "name" | "title">[] = [],
): string =>
  message
    .replace(INTERNAL, (_, name: string, at: number) => {
      const text = vocabulary.find((q) => q.name === name)?.title ?? label(name);
      return at && /^[A-Z][a-z]/.test(text) ? text[0].toLowerCase() + text.slice(1) : text;
    })
    .replace(/^./, (c) => c.toUpperCase());

/** Return the title of a quantity with its unit. */
export const quantityWords = ({ title, unit }: QuantityInfo): string =>
  unit ? `${title}, ${unitWords(unit)}` : title;

const SUBSCRIPTS: Record<string, string> = { s: "ₛ", t: "ₜ", v: "ᵥ" };

/** Return the symbol of a quantity; the part after an underscore is a subscript. */
export const symbolOf = ({ symbol }: QuantityInfo): string => lowered(symbol);

/** Return the meaning of a quantity, and its equation in the paper. */
export const explained = ({ meaning, equation }: QuantityInfo): string =>
  equation ? `${meaning} (${lowered(equation)})` : meaning;

const lowered = (formula: string): string =>
  formula.replace(/_(\w)\b/g, (_, letter: string) => SUBSCRIPTS[letter] ?? `_${letter}`);
