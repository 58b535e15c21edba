import { h, save, svg } from "../../shared/dom";
import { words } from "../../shared/numbers";
import type { Table } from "../evaluation";
import { type Drawn, files, revealFiles } from "./charts";
import { Drawing } from "./drawing";
import { standalone } from "./export";
import { Sizes } from "./sizes";

const OBJECT_DEG = 15;
const ENLARGED = 10;
const MIN_BAR_LENGTH = 1.5;
const [LOW, TALL] = [170, 240]; // px; the image strip has at most a fifth of its width as height

/** Objects of 15° x 15° along the image radius and in object space, with blur spots magnified 10 times. */
export class SquaresView {
  readonly element: HTMLElement;
  private readonly image = svg("svg", {
    class: "strip",
    role: "img",
    "aria-label": "Images of squares",
  });
  private readonly object = svg("svg", {
    class: "strip",
    role: "img",
    "aria-label": "Blur of squares",
  });
  private readonly drawings = new Map(
    [this.image, this.object].map((place) => [place, new Drawing(place)]),
  );
  private readonly sizes: Sizes;
  private first: Drawn | null = null;

  constructor() {
    const caption = h(
      "figcaption",
      {},
      h("span", {}, "Squares of 15° with blur"),
      h(
        "span",
        { className: "quiet" },
        "spots magnified 10 times; left: in the image, along its radius; right: in object space, tangential × sagittal",
      ),
      files("the squares", () => this.save(), ["svg"]),
    );
    this.element = h(
      "figure",
      { className: "plot wide" },
      caption,
      h("div", { className: "pair squares" }, this.image, this.object),
    );
    this.sizes = new Sizes([this.image, this.object], false, () => this.draw());
  }

  show(drawn: Drawn[]): void {
    this.first = drawn[0]?.evaluation.block("squares") ? drawn[0] : null;
    if (this.first) revealFiles(this.element);
    this.draw();
  }

  describe(): void {
    const table = this.first?.evaluation.block("squares");
    if (!table) return;
    const at = (name: string, i: number): string => words(Math.abs(table.column(name)[i]), 3);
    const rows = Array.from(
      table.column("omega_deg"),
      (omega, i) => `${omega}°: ${at("blur_t_deg", i)} by ${at("blur_s_deg", i)} degrees`,
    );
    this.image.setAttribute(
      "aria-label",
      `Images of squares of 15° along the image radius of ${words(this.first!.evaluation.summary!.rim_radius_px)} px, with their blur.`,
    );
    this.object.setAttribute(
      "aria-label",
      `Blur against squares of 15° in object space, tangential by sagittal: ${rows.join("; ")}.`,
    );
  }

  private save(): void {
    for (const [drawing, name] of [
      [this.image, "squares-image"],
      [this.object, "squares-object"],
    ] as const)
      save(new Blob([standalone(drawing)], { type: "image/svg+xml" }), `${name}.svg`);
  }

  private draw(): void {
    const table = this.first?.evaluation.block("squares");
    if (!table) return;
    this.drawImage(table);
    this.drawObject(table);
  }

  private drawImage(table: Table): void {
    const width = Math.max(200, this.sizes.of(this.image).width);
    const radius = this.first!.evaluation.summary!.rim_radius_px;
    const [h_px, dh, dw] = ["h_px", "dh_domega_px_per_deg", "width_px_per_deg"].map((n) =>
      table.column(n),
    );
    const half = (i: number): number => (OBJECT_DEG * dh[i]) / 2;
    const left = Math.min(0, ...Array.from(h_px, (h, i) => h - half(i)));
    const right = Math.max(
      radius,
      ...Array.from(h_px, (h, i) => Math.min(h + half(i), 1.4 * radius)),
    );
    const maxValue = Math.min(
      Math.max(...Array.from(dw, (w) => (Number.isFinite(w) ? OBJECT_DEG * w : 0))),
      0.6 * radius,
    );
    const scale = Math.min(
      (width - 8) / (right - left),
      Math.min(TALL, Math.max(LOW, 0.2 * width)) / maxValue,
    );
    const tallest = maxValue * scale;
    const [height, middle] = [tallest + 22, tallest / 2 + 18];
    const at = (px: number): number => 4 + (px - left) * scale;
    const drawing = this.begun(this.image, width, height);
    const rim = radius * scale;
    const dip = rim - Math.sqrt(Math.max(0, rim * rim - (height / 2) ** 2));
    drawing.add("line", { class: "axis", x1: 0, x2: width, y1: middle, y2: middle });
    drawing.add("path", {
      class: "rimline",
      d: `M${at(radius) - dip} ${middle - height / 2}Q${at(radius) + dip} ${middle} ${at(radius) - dip} ${middle + height / 2}`,
    });
    const shown = Array.from(dw.keys()).filter(
      (i) => dw[i] >= 0 && OBJECT_DEG * dw[i] <= 2 * radius,
    ); // objects at the opposite pole are unbounded
    const tall = (i: number): number => OBJECT_DEG * dw[i] * scale;
    const enlarged = (name: string, i: number): number => ENLARGED * table.column(name)[i] * scale;
    for (const i of shown)
      this.square(drawing, at(h_px[i]), middle, OBJECT_DEG * dh[i] * scale, tall(i), table, i);
    drawing.add("path", {
      class: "spot",
      d: shown
        .map((i) => spot(at(h_px[i]), middle, enlarged("blur_t_px", i), enlarged("blur_s_px", i)))
        .join(""),
    });
    for (const i of shown)
      this.text(
        drawing,
        at(h_px[i]),
        Math.max(11, middle - tall(i) / 2 - 4),
        `${words(table.column("omega_deg")[i], 2)}°`,
      );
    drawing.end();
  }

  private drawObject(table: Table): void {
    const width = Math.max(200, this.sizes.of(this.object).width);
    const columns = Math.min(table.rows, Math.max(4, Math.floor(width / 78)));
    const pitch = Math.min(width / columns, 104);
    const side = 0.74 * pitch;
    const row = side + 38;
    const drawing = this.begun(this.object, width, row * Math.ceil(table.rows / columns));
    const places = Array.from({ length: table.rows }, (_, i) => [
      pitch * ((i % columns) + 0.5),
      row * Math.floor(i / columns),
    ]);
    const [blur_t, blur_s] = ["blur_t_deg", "blur_s_deg"].map((name) => table.column(name));
    const blurred = [...places.keys()].filter(
      (i) => Number.isFinite(blur_t[i]) && Number.isFinite(blur_s[i]),
    );
    const enlarged = (blur: number): number =>
      Math.min(side, (Math.abs(blur) * ENLARGED * side) / OBJECT_DEG);
    places.forEach(([x, top], i) =>
      this.square(drawing, x, top + 16 + side / 2, side, side, table, i),
    );
    drawing.add("path", {
      class: "spot",
      d: blurred
        .map((i) =>
          spot(
            places[i][0],
            places[i][1] + 16 + side / 2,
            enlarged(blur_s[i]),
            enlarged(blur_t[i]),
          ),
        )
        .join(""),
    });
    places.forEach(([x, top], i) =>
      this.text(drawing, x, top + 11, `${words(table.column("omega_deg")[i], 2)}°`),
    );
    for (const i of blurred)
      this.text(
        drawing,
        places[i][0],
        places[i][1] + side + 30,
        `${Math.abs(blur_t[i]).toFixed(2)}° × ${Math.abs(blur_s[i]).toFixed(2)}°`,
      );
    drawing.end();
  }

  private begun(place: SVGElement, width: number, height: number): Drawing {
    const tall = String(Math.round(height));
    if (place.getAttribute("height") !== tall) place.setAttribute("height", tall);
    const drawing = this.drawings.get(place)!;
    drawing.begin(width, height);
    return drawing;
  }

  private square(
    drawing: Drawing,
    x: number,
    y: number,
    w: number,
    t: number,
    table: Table,
    i: number,
  ): void {
    const { ink } = this.first!;
    drawing.add(
      "rect",
      { class: "object", x: x - w / 2, y: y - t / 2, width: w, height: t, stroke: ink, fill: ink },
      reading(table, i),
    );
  }

  private text(drawing: Drawing, x: number, y: number, text: string): void {
    drawing.add("text", { x, y, "text-anchor": "middle" }, text);
  }
}

/** Return the path of an ellipse with semi-axes in px and a minimum visible size. */
function spot(x: number, y: number, across: number, down: number): string {
  const [rx, ry] = [across, down].map((size) => Math.max(MIN_BAR_LENGTH, Math.abs(size) / 2));
  return `M${x - rx} ${y}a${rx} ${ry} 0 1 0 ${2 * rx} 0a${rx} ${ry} 0 1 0 ${-2 * rx} 0z`;
}

/** Return the description of a square with units. */
function reading(table: Table, i: number): string {
  const at = (name: string): string => words(Math.abs(table.column(name)[i]), 3);
  const size = ["dh_domega_px_per_deg", "width_px_per_deg"].map((name) =>
    words(OBJECT_DEG * table.column(name)[i], 3),
  );
  return `Ω ${words(table.column("omega_deg")[i], 3)}°: image ${size.join(" × ")} px, blur ${at("blur_t_px")} × ${at("blur_s_px")} px, ${at("blur_t_deg")}° × ${at("blur_s_deg")}°`;
}
