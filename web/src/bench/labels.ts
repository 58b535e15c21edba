/** What units, parameters and quantities are called on the page. */

const UNITS: Record<string, string> = { deg: "°", um: "µm", deg2: "deg²", "px/deg": "px/°" };
export const unitWords = (unit: string): string => UNITS[unit] ?? unit;

/** A parameter's name without its unit. */
export const label = (name: string): string => {
  const text = name.replace(/_(mm|um|deg|px)$/, "").replaceAll("_", " ");
  const said = text.replace(/^(omega|theta) (max|min)$/, (_, angle: string, end: string) => `${angle === "omega" ? "Ω" : "Θ"} ${end}`);
  return said.replace(/^f number$/, "F-number").replace(/^working f number$/, "working F-number").replace(/^./, (c) => c.toUpperCase());
};

/** A quantity's name, with its unit. */
export function quantityWords(name: string, unit: string): string {
  const text = name.replace(/_(px_per_deg|deg2|px|deg|mm)$/, "").replaceAll("_", " ").replace(/ t$/, ", tangential").replace(/ s$/, ", sagittal");
  const said = text.replace(/^./, (c) => c.toUpperCase());
  return unit ? `${said}, ${unitWords(unit)}` : said;
}
