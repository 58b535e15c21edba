import { h, svg } from "../../shared/dom";
import type { CalibrationResult, CoverageInfo } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { arrows, byRadius, cellsOf, coveredIn, dots, timesFor } from "../drawing";
import type { Rim } from "../panels/camera";
import { px } from "../formatting";

const ARROW = 0.02; // length of a typical residual, relative to the longer image side
const [WIDTH, HEIGHT, LEFT, BOTTOM, TOP] = [420, 240, 46, 34, 8];

const figure = (title: string, note: string, drawing: Element): HTMLElement =>
  h(
    "figure",
    { className: "plot" },
    h(
      "figcaption",
      {},
      h("span", {}, title),
      note ? h("span", { className: "quiet" }, note) : null,
    ),
    drawing,
  );

/** Plot the distribution of corners over the field; darker cells contain more corners. */
export function coveragePlot(
  shown: CoverageInfo,
  size: readonly [number, number],
  corners: readonly (readonly [number, number])[],
  rim: Rim | null,
): HTMLElement {
  const [filled, all] = coveredIn(shown);
  const cells = cellsOf(shown).map(({ path, count }) =>
    svg("path", {
      class: count < shown.min_corners ? "cell empty" : "cell",
      d: path,
      "fill-opacity": (0.12 + 0.4 * Math.min(1, count / (6 * shown.min_corners))).toFixed(2),
    }),
  );
  const drawing = svg(
    "svg",
    {
      class: "field",
      viewBox: viewBox(size),
      role: "img",
      "aria-label": `Coverage of the field: ${filled} of ${all} cells contain at least ${shown.min_corners} corners.`,
    },
    svg("rect", { class: "frame", x: -0.5, y: -0.5, width: size[0], height: size[1] }),
    ...cells,
    svg("path", { class: "dots", d: dots(corners) }),
  );
  if (rim)
    drawing.append(
      svg("circle", { class: "rim", cx: rim.centre[0], cy: rim.centre[1], r: rim.radius }),
    );
  return figure(
    "Coverage",
    `${filled} of ${all} cells of the field contain at least ${shown.min_corners} corners`,
    drawing,
  );
}

/** Plot the residual vectors in the image. */
export function residualPlot(result: CalibrationResult): HTMLElement {
  const all = result.images.flatMap((p) => p.residuals);
  const times = timesFor(result.rms_px, ARROW * Math.max(...result.image_size));
  const drawing = svg(
    "svg",
    {
      class: "field",
      viewBox: viewBox(result.image_size),
      role: "img",
      "aria-label": `Residuals of ${all.length} corners in the image, RMS ${px(result.rms_px)}.`,
    },
    svg("rect", {
      class: "frame",
      x: -0.5,
      y: -0.5,
      width: result.image_size[0],
      height: result.image_size[1],
    }),
    svg("path", { class: "residuals", d: arrows(all, times) }),
  );
  return figure("Residuals in the image", `magnified ${times} times`, drawing);
}

/** Plot radial and tangential residuals over the image radius. */
export function radiusPlot(result: CalibrationResult): HTMLElement {
  const rows = byRadius(
    result.images.flatMap((p) => p.residuals),
    result.coverage.centre_px,
  );
  const outer = Math.max(...rows.map(([r]) => r), 1);
  const high = Math.max(
    ...rows.flatMap(([, along, across]) => [Math.abs(along), Math.abs(across)]),
    1e-6,
  );
  const x = (radius: number): number => LEFT + (radius / outer) * (WIDTH - LEFT - 8);
  const y = (value: number): number =>
    TOP + ((high - value) / (2 * high)) * (HEIGHT - TOP - BOTTOM);
  const label = (text: string, at: [number, number], anchor: string): SVGElement =>
    svg("text", { x: at[0], y: at[1], "text-anchor": anchor }, text);
  const drawing = svg(
    "svg",
    {
      class: "scatter",
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
      role: "img",
      "aria-label": `Residuals against the radius, up to ${words(outer, 3)} px: maximum ${words(high, 2)} px, radial or tangential.`,
    },
    svg("path", {
      class: "axis",
      d: `M${LEFT} ${TOP}V${HEIGHT - BOTTOM}M${LEFT} ${y(0)}H${WIDTH - 8}`,
    }),
    svg("path", { class: "dots along", d: dots(rows.map(([r, along]) => [x(r), y(along)])) }),
    svg("path", { class: "dots across", d: dots(rows.map(([r, , across]) => [x(r), y(across)])) }),
    ...[high, 0, -high].map((value) => label(words(value, 2), [LEFT - 6, y(value) + 4], "end")),
    ...[0, 0.5, 1].map((share) =>
      label(
        words(share * outer, 3),
        [x(share * outer), HEIGHT - BOTTOM + 16],
        share ? (share < 1 ? "middle" : "end") : "start",
      ),
    ),
    label("radius, px", [(LEFT + WIDTH) / 2, HEIGHT - 2], "middle"),
  );
  const legend = h(
    "span",
    { className: "quiet" },
    h("i", { className: "along" }),
    "radial ",
    h("i", { className: "across" }),
    "tangential",
  );
  return h(
    "figure",
    { className: "plot" },
    h("figcaption", {}, h("span", {}, "Residuals against radius, px"), legend),
    drawing,
  );
}

const viewBox = ([width, height]: readonly [number, number]): string =>
  `-0.5 -0.5 ${width} ${height}`;
