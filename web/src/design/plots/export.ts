/** Plots as files: curves as SVG and CSV, drawings as SVG without a style sheet. */

/** Curve: name, style and points; null where undefined. */
interface Line {
  name: string;
  ink: string;
  dash: number[] | undefined;
  x: ArrayLike<number>;
  y: ArrayLike<number | null>;
}

const [WIDTH, HEIGHT] = [640, 400];
const [LEFT, RIGHT, TOP, BOTTOM] = [76, 16, 34, 44];
const KEY = 18; // px, height of a legend row
const TICKS = 6;
const INK = "#1c1f21";
const STYLE = [
  "stroke",
  "stroke-width",
  "stroke-dasharray",
  "stroke-opacity",
  "fill",
  "fill-opacity",
  "opacity",
  "font-size",
  "text-anchor",
  "paint-order",
];

/** Return curves with labelled axes and a legend as SVG. */
export function svgOf(
  title: string,
  unit: string,
  [across, up]: readonly [across: string, up: string],
  lines: readonly Line[],
  range: readonly [number, number],
): string {
  const xs = lines.flatMap((l) => Array.from(l.x));
  const [x0, x1] = [Math.min(...xs), Math.max(...xs)];
  const [y0, y1] = range;
  const height = HEIGHT + KEY * lines.length;
  const u = (x: number): number => LEFT + ((x - x0) / (x1 - x0 || 1)) * (WIDTH - LEFT - RIGHT);
  const v = (y: number): number =>
    HEIGHT - BOTTOM - ((y - y0) / (y1 - y0 || 1)) * (HEIGHT - TOP - BOTTOM);
  const text = (at: string, words: string): string => `<text ${at}>${escaped(words)}</text>`;
  const grid = [
    ...ticks(x0, x1).map(
      (x) =>
        `<path d="M${u(x).toFixed(1)} ${TOP}V${HEIGHT - BOTTOM}"/>${text(`x="${u(x).toFixed(1)}" y="${HEIGHT - BOTTOM + 17}" text-anchor="middle"`, `${x}°`)}`,
    ),
    ...ticks(y0, y1).map(
      (y) =>
        `<path d="M${LEFT} ${v(y).toFixed(1)}H${WIDTH - RIGHT}"/>${text(`x="${LEFT - 7}" y="${(v(y) + 4).toFixed(1)}" text-anchor="end"`, String(y).replace("-", "−"))}`,
    ),
  ];
  const stroke = (l: Line): string =>
    `stroke="${l.ink}" stroke-width="2" fill="none"${l.dash ? ` stroke-dasharray="${l.dash.join(" ")}"` : ""}`;
  const curves = lines.map(
    (l) => `<path clip-path="url(#a)" d="${pathOf(l, u, v)}" ${stroke(l)}/>`,
  );
  const key = lines.map((l, i) => {
    const at = HEIGHT + KEY * i + 6;
    return `<path d="M${LEFT} ${at}h40" ${stroke(l)}/>${text(`x="${LEFT + 50}" y="${at + 4}"`, l.name)}`;
  });
  const heading = text(
    `x="${LEFT}" y="20" font-size="14" font-weight="600"`,
    unit ? `${title}, ${unit}` : title,
  );
  const below = text(
    `x="${(LEFT + WIDTH - RIGHT) / 2}" y="${HEIGHT - 8}" text-anchor="middle"`,
    across,
  );
  const beside = text(
    `transform="translate(14 ${(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)" text-anchor="middle"`,
    up,
  );
  return [
    `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${WIDTH} ${height}" width="${WIDTH}" height="${height}" font-family="system-ui, sans-serif" font-size="12" fill="${INK}">`,
    `<rect width="${WIDTH}" height="${height}" fill="#ffffff"/><clipPath id="a"><path d="M${LEFT} ${TOP}H${WIDTH - RIGHT}V${HEIGHT - BOTTOM}H${LEFT}Z"/></clipPath>`,
    `<g stroke="#dcdcd7" stroke-width="1">${grid.join("").replaceAll("<text ", '<text stroke="none" ')}</g>`,
    heading + below + beside + curves.join("") + key.join(""),
    "</svg>\n",
  ].join("\n");
}

/** Return curves as CSV: name of the design, field angle, columns. */
export function csvOf(
  columns: readonly string[],
  designs: readonly { name: string; rows: readonly (readonly number[])[] }[],
): string {
  const cell = (x: number): string => (Number.isFinite(x) ? String(Number(x.toPrecision(9))) : "");
  const word = (name: string): string =>
    /[",\n]/.test(name) ? `"${name.replaceAll('"', '""')}"` : name;
  const rows = designs.flatMap(({ name, rows: all }) =>
    all.map((row) => [word(name), ...row.map(cell)].join(",")),
  );
  return [["design", "omega_deg", ...columns].join(","), ...rows, ""].join("\n");
}

/** Return a drawing of the page as SVG with inlined styles. */
export function standalone(drawing: SVGElement): string {
  const copy = drawing.cloneNode(true) as SVGElement;
  const [from, to] = [drawing, copy].map(
    (root) => [root, ...root.querySelectorAll<SVGElement>("*")] as SVGElement[],
  );
  from.forEach((element, i) => {
    const looks = getComputedStyle(element);
    for (const name of STYLE) to[i].setAttribute(name, looks.getPropertyValue(name));
    for (const name of ["class", "style", "tabindex", "role"]) to[i].removeAttribute(name);
  });
  const [, , width, height] = (drawing.getAttribute("viewBox") ?? "0 0 100 100").split(" ");
  for (const [name, value] of Object.entries({
    xmlns: "http://www.w3.org/2000/svg",
    width,
    height,
    "font-family": "system-ui, sans-serif",
  }))
    copy.setAttribute(name, value);
  return `${new XMLSerializer().serializeToString(copy)}\n`;
}

function pathOf({ x, y }: Line, u: (x: number) => number, v: (y: number) => number): string {
  let isDown = false;
  let d = "";
  for (let i = 0; i < x.length; i++) {
    const value = y[i];
    const is = value !== null && Number.isFinite(value);
    if (is) d += `${isDown ? "L" : "M"}${u(x[i]).toFixed(2)} ${v(value).toFixed(2)}`;
    isDown = is;
  }
  return d;
}

/** Round tick values between low and high. */
function ticks(low: number, high: number): number[] {
  const raw = (high - low || 1) / TICKS;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 3, 5, 10].map((k) => k * power).find((s) => s >= raw * 0.999)!;
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, i) =>
    Number(((first + i) * step).toPrecision(10)),
  );
}

const escaped = (text: string): string =>
  text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
