import { h, svg } from "../../shared/dom";
import type { AsBuiltResult, YieldResult } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { logAxis } from "./log_axis";
import { calibrationWords, enlargement, errorWords, sizeWords } from "./names";

/** As-built sensor: values, object positions, and displacements by calibration. */
export interface AsBuiltDisplacement extends AsBuiltResult {
  places: Float32Array;
  left: Float32Array[];
}

const MAX_LENGTH = 0.16; // drawn length of the maximum displacement, relative to the image radius
const MARGIN = 1.2;
const MAX_BARS = 14;
const [ROW, BAR, AXIS] = [19, 13, 34]; // px
const DEPTHS = ["none", "affine", "pose"];

/** Displacement due to errors, residual after a calibration, and effect of each error. */
export class ToleranceCharts {
  readonly element: HTMLElement;
  private readonly maps = [0, 1].map(() =>
    svg("svg", {
      class: "moved",
      role: "img",
      viewBox: "-1 -1 2 2",
      "aria-label": "Image displacement",
    }),
  );
  private readonly captions = [
    h("span", { className: "quiet" }),
    h("span", { className: "quiet" }),
  ];
  private readonly bars = svg("svg", {
    class: "tornado",
    role: "img",
    "aria-label": "Effect of each error",
  });
  private readonly legend = h("p", { className: "legend" });
  private result: YieldResult | null = null;
  private calibrations: readonly string[] = [];

  constructor() {
    const part = (
      title: string,
      caption: HTMLElement | null,
      body: Element,
      after: HTMLElement | null = null,
    ): HTMLElement =>
      h(
        "div",
        {},
        title ? h("p", { className: "part" }, h("b", {}, title), caption) : null,
        body as HTMLElement,
        after,
      );
    const group = (title: string, explanation: string, ...parts: HTMLElement[]): HTMLElement =>
      h(
        "section",
        { "aria-label": title },
        h("figcaption", {}, h("span", {}, title), h("span", { className: "quiet" }, explanation)),
        h("div", { className: "parts" }, ...parts),
      );
    this.element = h(
      "figure",
      { className: "plot wide tolerances", hidden: true },
      group(
        "Sensor with the present errors",
        "displacement of objects over the field",
        part("As built", this.captions[0], this.maps[0]),
        part("After calibration", this.captions[1], this.maps[1]),
      ),
      group(
        "Errors at their tolerances",
        "maximum displacement due to each error alone",
        part("", null, this.bars, this.legend),
      ),
    );
    new ResizeObserver(() => this.drawBars()).observe(this.element);
  }

  /** Draw displacements before and after calibration. */
  showMoved(moved: AsBuiltDisplacement, calibrations: readonly string[], after: string): void {
    const deep = Math.max(calibrations.indexOf(after), 0);
    [0, deep].forEach((depth, k) =>
      this.drawMap(
        this.maps[k],
        this.captions[k],
        moved,
        depth,
        k ? `after ${calibrationWords(calibrations[depth])}` : "",
      ),
    );
  }

  /** Draw the effect of each error (tornado chart). */
  showYield(result: YieldResult, calibrations: readonly string[]): void {
    this.result = result;
    this.calibrations = calibrations;
    this.drawBars();
  }

  private drawMap(
    place: SVGElement,
    caption: HTMLElement,
    moved: AsBuiltDisplacement,
    depth: number,
    after: string,
  ): void {
    const { radius_px: radius, objects: n, places } = moved;
    const maximum = moved.motion_px[depth];
    const left = moved.left[depth];
    const times = enlargement(maximum ?? 0, MAX_LENGTH * radius);
    const side = MARGIN * radius;
    place.setAttribute("viewBox", `${-side} ${-side} ${2 * side} ${2 * side}`);
    place.replaceChildren(svg("circle", { class: "rim", r: radius, cx: 0, cy: 0 }));
    if (maximum === null) caption.textContent = `${moved.lost} of ${n} objects are not imaged`;
    else {
      for (let i = 0; i < n; i++) {
        const [x, y] = [places[i], places[n + i]];
        place.append(
          svg("line", { x1: x, y1: y, x2: x + times * left[i], y2: y + times * left[n + i] }),
          svg("circle", { class: "object", r: 0.009 * side, cx: x, cy: y }),
        );
      }
      caption.textContent = `${after ? `${after}: ` : ""}${sizeWords(maximum, " px")} at most${maximum * times < 1 ? "" : `; drawn ${times} times as long`}`;
    }
    place.setAttribute(
      "aria-label",
      `Displacement of ${n} objects in the image${after && `, ${after}`}: ${caption.textContent}.`,
    );
  }

  private drawBars(): void {
    if (!this.result || this.element.hidden) return;
    const rows = this.result.rows.slice(0, MAX_BARS);
    const width = Math.max(240, this.bars.getBoundingClientRect().width);
    const left = Math.min(190, 0.46 * width);
    const depths = DEPTHS.map((name) => this.calibrations.indexOf(name));
    const all = rows.flatMap((row) => depths.map((d) => row.motion_px[d] ?? 0));
    const axis = logAxis(all);
    const length = width - left - 46;
    const at = (value: number | null): number => (value === null ? 1 : axis.place(value)) * length;
    const bottom = ROW * rows.length + 4;
    const height = bottom + AXIS;
    this.bars.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.bars.setAttribute("height", String(height));
    this.bars.replaceChildren(
      ...axis.ticks.flatMap((value) => {
        const x = left + at(value);
        return [
          svg("line", { class: "tick", x1: x, x2: x, y1: 0, y2: bottom + 3 }),
          svg("text", { class: "tick", x, y: bottom + 14, "text-anchor": "middle" }, String(value)),
        ];
      }),
      svg(
        "text",
        { class: "tick", x: left + length / 2, y: bottom + 29, "text-anchor": "middle" },
        "Displacement, px (logarithmic)",
      ),
    );
    rows.forEach((row, i) => {
      const y = 2 + i * ROW;
      const name = errorWords(row.name);
      this.bars.append(
        svg(
          "text",
          { x: left - 6, y: y + BAR - 2, "text-anchor": "end" },
          svg("title", {}, `${name}, ± ${words(row.tolerance, 3)}`),
          name,
        ),
      );
      depths.forEach((d, k) => {
        const thick = BAR * [1, 0.62, 0.3][k];
        this.bars.append(
          svg("rect", {
            class: DEPTHS[k],
            x: left,
            y: y + (BAR - thick) / 2,
            width: at(row.motion_px[d]),
            height: thick,
          }),
        );
      });
      this.bars.append(
        svg(
          "text",
          { x: left + at(row.motion_px[depths[0]]) + 4, y: y + BAR - 2 },
          row.motion_px[depths[0]] === null ? "lost" : words(row.motion_px[depths[0]], 2),
        ),
      );
    });
    this.legend.replaceChildren(
      ...DEPTHS.map((name) =>
        h(
          "span",
          { className: name },
          name === "none" ? "as built" : `after ${calibrationWords(name)}`,
        ),
      ),
    );
    const descriptions = rows
      .slice(0, 5)
      .map(
        (row) =>
          `${errorWords(row.name)} ${row.motion_px[depths[0]] === null ? "objects are not imaged" : `${words(row.motion_px[depths[0]], 3)} pixels`}`,
      );
    this.bars.setAttribute(
      "aria-label",
      `Maximum image displacement due to each error at its tolerance, in descending order: ${descriptions.join("; ")}.`,
    );
  }
}
