import { h, unique } from "../../shared/dom";
import type { ErrorSourceInfo } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { unitWords } from "../labels";
import { partAndError } from "./names";

/** Events of an error row. */
interface RowHands {
  tried: (name: string, value: number) => void;
  setTolerance: (name: string, tolerance: number) => void;
}

const REACH = 2; // slider range, in tolerances to either side

/** Error source: slider and field of its value, and field of its tolerance. */
export class ErrorRow {
  readonly element: HTMLElement;
  private readonly slider: HTMLInputElement;
  private readonly value: HTMLInputElement;
  private readonly tolerance: HTMLInputElement;

  constructor(
    private readonly error: ErrorSourceInfo,
    private of: { value: number; tolerance: number },
    private readonly callbacks: RowHands,
  ) {
    const [id, unit, [part, own]] = [unique(), unitWords(error.unit), partAndError(error.name)];
    const title = `${part} ${own}`;
    this.slider = h("input", {
      type: "range",
      min: String(-REACH),
      max: String(REACH),
      step: "0.01",
      "aria-label": `${title}, slider`,
    });
    this.value = h("input", { type: "number", id, step: "any", "aria-describedby": `${id}h` });
    this.tolerance = h("input", {
      type: "number",
      min: "0",
      step: "any",
      "aria-label": `Tolerance of ${title}${unit && `, ${unit}`}`,
    });
    this.element = h(
      "div",
      { className: "field error", title: error.meaning },
      h(
        "label",
        { htmlFor: id },
        h("span", { className: "hidden" }, `${part} `),
        h("span", { className: "own" }, own),
      ),
      h(
        "span",
        { className: "entry" },
        this.value,
        h("span", { className: "unit" }, "±"),
        this.tolerance,
        h("span", { className: "unit" }, unit),
      ),
      this.slider,
      h("span", { id: `${id}h`, className: "hidden" }, `${error.meaning}${unit && `, ${unit}`}`),
    );
    this.slider.addEventListener("input", () =>
      this.try(Number(this.slider.value) * this.of.tolerance, this.slider),
    );
    this.value.addEventListener(
      "input",
      () => this.value.value !== "" && this.try(Number(this.value.value), this.value),
    );
    this.value.addEventListener("change", () => this.show());
    this.tolerance.addEventListener("change", () => this.hold());
    this.show();
  }

  /** Display other values. */
  set(of: { value: number; tolerance: number }): void {
    this.of = of;
    this.show();
  }

  private try(value: number, from: HTMLInputElement): void {
    this.of = { ...this.of, value };
    this.show(from);
    this.callbacks.tried(this.error.name, value);
  }

  private hold(): void {
    const tolerance = Number(this.tolerance.value);
    if (this.tolerance.value !== "" && tolerance >= 0) {
      this.of = { ...this.of, tolerance };
      this.callbacks.setTolerance(this.error.name, tolerance);
    }
    this.show();
  }

  private show(from?: HTMLInputElement): void {
    const { value, tolerance } = this.of;
    if (from !== this.value) this.value.value = String(Number(value.toPrecision(3)));
    if (from !== this.slider) this.slider.value = String(tolerance ? value / tolerance : 0);
    this.tolerance.value = String(Number(tolerance.toPrecision(3)));
    this.slider.disabled = tolerance === 0;
    this.slider.setAttribute(
      "aria-valuetext",
      `${words(value, 3)} ${unitWords(this.error.unit)}`.trim(),
    );
  }
}
