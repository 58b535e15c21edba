import { h, reveal, unique, write } from "../../shared/dom";
import type { DesignStart, DesignSummary, RequirementResult } from "../../shared/messages";
import { words } from "../../shared/numbers";
import type { Design, Tables } from "../model/design";
import { type Limit, limitsOf, withLimits } from "../model/requirements";
import { label, labelledMessage, quantityWords, unitWords } from "../labels";

interface Callbacks {
  now: () => Design;
  summary: () => DesignSummary | null;
  edit: (design: Design) => void;
  settle: () => void;
}

const USUAL: Limit = { quantity: "total_blur_px", at_most: 5 };
const CYCLES = 0.25; // default frequency of an MTF limit, cycles per pixel
const ROUNDING = 1e-6; // relative margin below which a requirement is only just met
const INFINITE = 1e11; // distance in mm above which infinity is displayed

/** Requirements with their results. */
export class RequirementsPanel {
  private readonly body = h("div", { className: "requirements" });
  private readonly verdict = h("p", { className: "verdict", role: "status" });
  private readonly problem = h("p", { className: "problem", role: "alert", hidden: true });
  private shape = "";
  private readonly marks = new Map<string, HTMLElement>();
  private inputs: { input: HTMLInputElement; value: () => number | null | undefined }[] = [];

  constructor(
    private readonly place: HTMLElement,
    private readonly parts: DesignStart,
    private readonly callbacks: Callbacks,
  ) {
    place.append(
      this.verdict,
      this.body,
      this.problem,
      h(
        "div",
        { className: "row" },
        h("button", { type: "button", onclick: () => this.add() }, "Add a requirement"),
      ),
    );
  }

  /** Scroll the requirements into view. */
  reveal(): void {
    this.place.scrollIntoView({ block: "start" });
  }

  show(design: Design): void {
    const limits = limitsOf(design.requirements);
    const shape = JSON.stringify([
      design.requirements === null,
      limits.map((l) => [l.quantity, Boolean(l.omega_deg)]),
    ]);
    if (shape !== this.shape) {
      this.shape = shape;
      this.build(design);
    }
    for (const { input, value } of this.inputs) {
      const number = value();
      if (document.activeElement !== input)
        input.value =
          number === null || number === undefined
            ? ""
            : String(number >= INFINITE ? "" : +number.toPrecision(8));
    }
  }

  /** Display the result of each requirement: met or not, margin, critical field angle. */
  showResults(rows: RequirementResult[], error: string | null): void {
    reveal(this.problem, error !== null);
    write(this.problem, labelledMessage(error ?? "", this.parts.quantities));
    for (const mark of this.marks.values()) mark.replaceChildren();
    const additional: HTMLElement[] = [];
    for (const row of rows) {
      const mark = this.marks.get(row.limit === null ? row.name : String(row.limit));
      if (mark) mark.replaceChildren(...verdictOf(row));
      else
        additional.push(
          h(
            "li",
            {},
            h("span", {}, `${this.titleOf(row.name)} ${requestedOf(row)}`),
            h("span", { className: "mark" }, ...verdictOf(row)),
          ),
        );
    }
    this.body.querySelector(".others")?.replaceChildren(...additional);
    const violations = rows.filter((r) => !r.is_met).length;
    reveal(this.verdict, rows.length > 0);
    write(
      this.verdict,
      violations ? `${violations} of ${rows.length} not met` : `All ${rows.length} met`,
    );
    this.verdict.classList.toggle("missed", violations > 0);
  }

  private titleOf(name: string): string {
    return this.parts.quantities.find((q) => q.name === name)?.title ?? label(name);
  }

  private build(design: Design): void {
    this.marks.clear();
    this.inputs = [];
    this.body.replaceChildren();
    if (design.requirements === null) {
      this.verdict.hidden = true;
      this.body.append(
        h("p", { className: "words" }, "No requirements. Add one, or open a requirement file."),
      );
      return;
    }
    const limits = limitsOf(design.requirements);
    this.body.append(
      this.field(),
      h("ul", { className: "others" }),
      ...limits.map((l, i) => this.limit(l, i)),
    );
  }

  private field(): HTMLElement {
    const field = (): Tables => this.callbacks.now().requirements!.field as Tables;
    const distances = (): [number, number] => spanOf(field().object_distance_mm);
    const setField = (change: Tables): void =>
      this.set({ ...this.callbacks.now().requirements!, field: { ...field(), ...change } });
    const mark = (name: string): HTMLElement => this.mark(name);
    return h(
      "div",
      { className: "limit" },
      h(
        "div",
        { className: "line" },
        h("span", { className: "what" }, "Maximum field angle"),
        this.number(
          "Maximum field angle, degrees",
          () => field().omega_max_deg as number,
          (v) => setField({ omega_max_deg: v ?? 135 }),
        ),
        h("span", { className: "unit" }, "°"),
      ),
      mark("omega_max_deg"),
      h("span", { className: "what" }, "Objects"),
      h(
        "div",
        { className: "line" },
        h("span", { className: "unit" }, "from"),
        this.number(
          "Minimum object distance, mm",
          () => distances()[0],
          (v) => setField({ object_distance_mm: [v ?? 1e12, Math.max(v ?? 1e12, distances()[1])] }),
        ),
        h("span", { className: "unit" }, "to"),
        this.number(
          "Maximum object distance, mm; empty for infinity",
          () => distances()[1],
          (v) => setField({ object_distance_mm: [Math.min(distances()[0], v ?? 1e12), v ?? 1e12] }),
        ),
        h("span", { className: "unit" }, "mm"),
      ),
    );
  }

  private limit(limit: Limit, index: number): HTMLElement {
    const now = (): Limit => limitsOf(this.callbacks.now().requirements)[index];
    const set = (change: Partial<Limit>): void =>
      this.setLimits(
        limitsOf(this.callbacks.now().requirements).map((l, i) =>
          i === index ? { ...l, ...change } : l,
        ),
      );
    const quantity = this.parts.quantities.find((q) => q.name === limit.quantity)!;
    const select = h(
      "select",
      { "aria-label": "Quantity", title: quantity.meaning },
      ...this.parts.quantities.map((q) =>
        h("option", { value: q.name, title: q.meaning }, quantityWords(q)),
      ),
    );
    select.value = limit.quantity;
    const isOfFrequency = (name: string): boolean => this.parts.of_frequency.includes(name);
    select.addEventListener("change", () =>
      set({
        quantity: select.value,
        cycles_per_px: isOfFrequency(select.value) ? (now().cycles_per_px ?? CYCLES) : null,
      }),
    );
    const remove = h(
      "button",
      {
        type: "button",
        className: "small",
        "aria-label": `Remove the requirement on ${quantity.title}`,
        onclick: () =>
          this.setLimits(limitsOf(this.callbacks.now().requirements).filter((_, i) => i !== index)),
      },
      "×",
    );
    const part = h(
      "button",
      {
        type: "button",
        className: "small",
        onclick: () =>
          set({
            omega_deg: now().omega_deg
              ? null
              : [0, this.callbacks.now().requirements!.field.omega_max_deg as number],
          }),
        title: "Switch between a part of the field and the whole field",
      },
      limit.omega_deg ? "full field" : "partial field",
    );
    return h(
      "div",
      { className: "limit" },
      h("div", { className: "line" }, select, remove),
      h("p", { className: "words meaning" }, quantity.meaning),
      h(
        "div",
        { className: "line" },
        h("span", { className: "unit" }, "≥"),
        this.number(
          `${quantity.title} at least`,
          () => now()?.at_least,
          (v) => set({ at_least: v }),
        ),
        h("span", { className: "unit" }, "≤"),
        this.number(
          `${quantity.title} at most`,
          () => now()?.at_most,
          (v) => set({ at_most: v }),
        ),
        h("span", { className: "unit" }, unitWords(quantity.unit)),
      ),
      isOfFrequency(limit.quantity)
        ? h(
            "div",
            { className: "line" },
            h("span", { className: "unit" }, "at"),
            this.number(
              "Spatial frequency, cycles per pixel",
              () => now()?.cycles_per_px,
              (v) => set({ cycles_per_px: v ?? CYCLES }),
            ),
            h("span", { className: "unit" }, "cycles/px"),
          )
        : null,
      limit.omega_deg
        ? h(
            "div",
            { className: "line" },
            h("span", { className: "unit" }, "Ω from"),
            this.number(
              "Minimum field angle, degrees",
              () => now()?.omega_deg?.[0],
              (v) => set({ omega_deg: [v ?? 0, now().omega_deg![1]] }),
            ),
            h("span", { className: "unit" }, "to"),
            this.number(
              "Maximum field angle of the limit, degrees",
              () => now()?.omega_deg?.[1],
              (v) => set({ omega_deg: [now().omega_deg![0], v ?? 135] }),
            ),
            h("span", { className: "unit" }, "°"),
          )
        : null,
      h("div", { className: "line" }, this.mark(String(index)), part),
    );
  }

  private mark(name: string): HTMLElement {
    const mark = h("p", { className: "mark" });
    this.marks.set(name, mark);
    return mark;
  }

  private number(
    title: string,
    value: () => number | null | undefined,
    set: (value: number | null) => void,
  ): HTMLInputElement {
    const input = h("input", {
      type: "number",
      step: "any",
      id: unique(),
      "aria-label": title,
      placeholder: title.includes("object distance") ? "∞" : "",
    });
    input.addEventListener("change", () => set(input.value === "" ? null : Number(input.value)));
    this.inputs.push({ input, value });
    return input;
  }

  private add(): void {
    const { requirements } = this.callbacks.now();
    if (requirements) return this.setLimits([...limitsOf(requirements), { ...USUAL }]);
    const field = this.callbacks.summary()?.field_deg[1] ?? 135;
    this.set({
      field: { omega_max_deg: Math.floor(field), object_distance_mm: [1e12, 1e12] },
      limit: [{ ...USUAL }],
    });
  }

  private setLimits(limits: Limit[]): void {
    this.set(withLimits(this.callbacks.now().requirements!, limits));
  }

  private set(requirements: Tables): void {
    this.callbacks.edit({ ...this.callbacks.now(), requirements });
    this.callbacks.settle();
  }
}

const spanOf = (value: unknown): [number, number] =>
  Array.isArray(value)
    ? (value as [number, number])
    : typeof value === "number"
      ? [value, value]
      : [1e12, 1e12];

const withUnit = (value: number | null, unit: string, digits = 4): string => {
  const text = unitWords(unit);
  return `${words(value, digits)}${text === "°" ? "°" : text && ` ${text}`}`;
};

/** Return the requested bounds of a requirement. */
function requestedOf({ at_least, at_most, unit }: RequirementResult): string {
  if (at_least !== null && at_least === at_most) return `= ${withUnit(at_least, unit)}`;
  const sides = [
    at_least === null ? "" : `≥ ${withUnit(at_least, unit)}`,
    at_most === null ? "" : `≤ ${withUnit(at_most, unit)}`,
  ];
  return sides.filter(Boolean).join(", ");
}

/** Return the result as symbol, value and margin. */
function verdictOf(row: RequirementResult): HTMLElement[] {
  const isJust =
    row.is_met &&
    row.margin !== null &&
    Math.abs(row.margin) <= ROUNDING * Math.abs(row.value ?? 0);
  const margin =
    row.margin === null ? "" : `, margin ${isJust ? "0" : withUnit(row.margin, row.unit, 3)}`;
  const sign = h(
    "b",
    { className: row.is_met ? "met" : "missed" },
    row.is_met ? " ✓ met" : " ✗ not met",
  );
  const where = row.omega_deg === null ? "" : ` at ${words(row.omega_deg, 3)}°`;
  return [sign, h("span", {}, `: ${withUnit(row.value, row.unit)}${where}${margin}`)];
}
