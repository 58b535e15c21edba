/** What units, parameters and quantities are called on the page. */
import type { QuantityOf } from "../shared/messages";

const UNITS: Record<string, string> = { deg: "°", um: "µm", deg2: "deg²", "px/deg": "px/°" };
export const unitWords = (unit: string): string => UNITS[unit] ?? unit;

/** A parameter's name without its unit. */
export const label = (name: string): string => {
  const text = name.replace(/_(mm|um|deg|px)$/, "").replaceAll("_", " ");
  const said = text.replace(
    /^(omega|theta) (max|min)$/,
    (_, angle: string, end: string) => `${angle === "omega" ? "Ω" : "Θ"} ${end}`,
  );
  return said
    .replace(/^f number$/, "F-number")
    .replace(/^working f number$/, "working F-number")
    .replace(/^./, (c) => c.toUpperCase());
};

/** A quantity's title, with its unit. */
export const quantityWords = ({ title, unit }: QuantityOf): string =>
  unit ? `${title}, ${unitWords(unit)}` : title;

const SUBSCRIPTS: Record<string, string> = { s: "ₛ", t: "ₜ", v: "ᵥ" };

/** A quantity's symbol; what stands after an underscore is a subscript. */
export const symbolOf = ({ symbol }: QuantityOf): string => lowered(symbol);

/** What a quantity is, and the paper's equation of it. */
export const explained = ({ meaning, equation }: QuantityOf): string =>
  equation ? `${meaning} (${lowered(equation)})` : meaning;

const lowered = (formula: string): string =>
  formula.replace(/_(\w)\b/g, (_, letter: string) => SUBSCRIPTS[letter] ?? `_${letter}`);
