import { h, labelledField, reveal, titledSection, unique, write } from "../../shared/dom";
import type {
  DesignStart,
  ParameterInfo,
  PartInfo,
  SliderValues,
  ApiError,
} from "../../shared/messages";
import { type Design, nameOf, type Tables, withEntry } from "../model/design";
import { label, labelledMessage } from "../labels";
import { alone } from "../data_source";
import { Field } from "./field";
import type { Violations } from "./feasible_ranges";

/** Interface of the Design tab for the form. */
interface Callbacks {
  now: () => Design;
  edit: (design: Design) => void;
  /** Commit the design; successive key presses on one control are one undo step. */
  settle: (control?: string | null) => void;
  change: (target: "mirror" | "lens" | "focus", to: string) => void;
}

const MAX_FIELDS = 16; // maximum number of list elements with individual fields
const DISTANCE = "distance"; // object distance, not a parameter of the sensor
const FAR: ParameterInfo = {
  name: DISTANCE,
  unit: "mm",
  low: 1,
  high: 1e7,
  description: "distance between the mirror and the objects",
  choices: [],
  is_list: false,
  is_integer: false,
  is_optional: false,
  default: null,
};

/** Sliders and number fields generated from the metadata of the parts. */
export class Form {
  private readonly fields = new Map<string, Field>();
  private readonly defaults = new Map<string, number>();
  private readonly unfolded = new Set<string>();
  private shape = "";
  private last = "";
  private named: HTMLInputElement | null = null;
  private readonly mirror: HTMLSelectElement;
  private readonly lens: HTMLSelectElement;
  private readonly follows = h("input", { type: "checkbox" });
  private readonly infinite = h("input", { type: "checkbox" });
  private readonly body = h("div", { className: "sections" });
  private readonly problem = h("p", { className: "problem", hidden: true });

  constructor(
    place: HTMLElement,
    private readonly parts: DesignStart,
    private readonly callbacks: Callbacks,
  ) {
    this.mirror = choice(
      parts.mirrors.map((p) => p.kind),
      (kind) => callbacks.change("mirror", kind),
    );
    this.lens = choice(
      parts.lenses.map((p) => p.kind),
      (kind) => callbacks.change("lens", kind),
    );
    this.mirror.setAttribute("aria-label", "Type of mirror");
    this.lens.setAttribute("aria-label", "Type of lens");
    if (alone)
      for (const kind of [this.mirror, this.lens])
        Object.assign(kind, {
          disabled: true,
          title:
            "Changing the type requires the program; on this page, start from a sensor of that type.",
        });
    this.follows.addEventListener("change", () =>
      this.settled({ ...callbacks.now(), follows_mapping: this.follows.checked }),
    );
    this.infinite.addEventListener("change", () =>
      this.settled({
        ...callbacks.now(),
        distance: this.infinite.checked ? null : 10 * this.rim(),
      }),
    );
    place.append(this.problem, this.body);
  }

  /** Set the initial design. */
  begin(design: Design): void {
    this.show(design);
    for (const [key, field] of this.fields) {
      const value = valueAt(design, key) ?? this.defaults.get(key);
      if (value !== undefined) field.begin(value);
    }
  }

  /** Display a design; fields are recreated only if their set changes. */
  show(design: Design): void {
    const shape = this.shapeOf(design);
    if (shape !== this.shape) {
      this.shape = shape;
      this.build(design);
    }
    for (const [key, field] of this.fields) {
      const value = valueAt(design, key) ?? this.defaults.get(key);
      if (value !== undefined) field.set(value);
    }
    if (this.named && document.activeElement !== this.named) this.named.value = nameOf(design);
    this.mirror.value = design.tables.mirror.kind as string;
    this.lens.value = design.tables.lens.kind as string;
    this.follows.checked = design.follows_mapping;
    this.infinite.checked = design.distance === null;
  }

  /** Display the error of a design at its field, or at the last changed field. */
  showError(error: ApiError | null): void {
    const key =
      error &&
      ([...this.fields.keys()].find(
        (k) => k.startsWith(error.path.join(".")) && error.path.length > 1,
      ) ??
        this.last);
    for (const [k, field] of this.fields) field.showError(k === key ? error!.message : null);
    const isOfNoField = error !== null && !this.fields.has(key ?? "");
    reveal(this.problem, isOfNoField);
    write(this.problem, isOfNoField ? labelledMessage(error.message) : "");
  }

  /** Return the entries of the visible sliders with sample values. */
  sliders(): SliderValues[] {
    const visible = [...this.fields].filter(
      ([key, field]) => key !== DISTANCE && !field.element.closest("details:not([open])"),
    );
    return visible.map(([key, field]) => ({ path: key.split("."), values: field.along }));
  }

  /** Mark the feasible ranges of those sliders. */
  showFeasible(
    sliders: readonly SliderValues[],
    violations: readonly (readonly Violations[])[],
  ): void {
    sliders.forEach(({ path }, i) => this.fields.get(path.join("."))?.showFeasible(violations[i]));
  }

  /** Remove the marks; an active slider keeps its own if the requirements are unchanged. */
  clearFeasible(isPending: boolean): void {
    for (const [key, field] of this.fields)
      if (isPending || key !== this.last) field.showFeasible(null);
  }

  private build(design: Design): void {
    const open = document.activeElement?.closest(".field")?.querySelector("label")?.textContent;
    this.fields.clear();
    this.defaults.clear();
    const { tables } = design;
    this.body.replaceChildren(
      titledSection(
        "Mirror",
        this.name(design),
        labelledField("Type", this.mirror),
        ...this.of("mirror", kindOf(this.parts.mirrors, tables.mirror), tables.mirror),
        ...this.distance(design),
      ),
      ...(tables.mirror_pose
        ? [titledSection("Misalignment", ...this.pose(tables.mirror_pose as Tables))]
        : []),
      ...(tables.secondary
        ? [titledSection("Second mirror", ...this.second(tables.secondary as Tables))]
        : []),
      titledSection(
        "Lens",
        labelledField("Type", this.lens),
        ...this.of("lens", kindOf(this.parts.lenses, tables.lens), tables.lens),
        this.focus(),
      ),
      titledSection("Imager", ...this.of("imager", this.parts.imager, tables.imager)),
      titledSection("Objects", ...this.objects(design)),
    );
    const again = [...this.body.querySelectorAll("label")].find((l) => l.textContent === open);
    if (open)
      again?.closest(".field")?.querySelector<HTMLInputElement>("input[type=range]")?.focus();
  }

  private of(section: string, part: PartInfo, table: Tables): HTMLElement[] {
    const isUsual = (p: ParameterInfo): boolean =>
      p.is_optional && p.default !== null && (table[p.name] ?? p.default) === p.default;
    const fieldsOf = (all: ParameterInfo[]): HTMLElement[] =>
      all.flatMap((p) => this.entry(section, p, table[p.name] ?? p.default));
    const more = fieldsOf(part.parameters.filter(isUsual));
    return [
      ...fieldsOf(part.parameters.filter((p) => !isUsual(p))),
      ...(more.length ? [this.more(section, more)] : []),
    ];
  }

  private entry(section: string, p: ParameterInfo, value: unknown): HTMLElement[] {
    if (p.choices.length)
      return [this.words(section, p, (value as string | undefined) ?? p.choices[0])];
    if (value === undefined || value === null) return [];
    return p.is_list
      ? this.list(section, p, value as number[])
      : [this.number(`${section}.${p.name}`, p, label(p.name), value as number)];
  }

  /** Create the collapsed group of rarely used parameters. */
  private more(section: string, fields: HTMLElement[]): HTMLElement {
    const details = h(
      "details",
      { className: "more", open: this.unfolded.has(section) },
      h("summary", {}, "More"),
      h("div", {}, ...fields),
    );
    details.addEventListener("toggle", () =>
      details.open ? this.unfolded.add(section) : this.unfolded.delete(section),
    );
    return details;
  }

  private number(key: string, p: ParameterInfo, title: string, value: number): HTMLElement {
    const changed = (v: number): void => {
      this.last = key;
      this.callbacks.edit(changedAt(this.callbacks.now(), key, v));
    };
    const field = new Field(p, title, value, changed, (isByKey) =>
      this.callbacks.settle(isByKey ? key : null),
    );
    this.fields.set(key, field);
    if (p.default !== null) this.defaults.set(key, p.default);
    return field.element;
  }

  private list(section: string, p: ParameterInfo, values: number[]): HTMLElement[] {
    if (values.length > MAX_FIELDS) return [this.text(section, p, values)];
    const fields = values.map((v, i) =>
      this.number(`${section}.${p.name}.${i}`, p, `${label(p.name).replace(/s$/, "")} ${i + 1}`, v),
    );
    if (p.name !== "coefficients") return fields;
    const set = (to: number[]): void =>
      this.settled(withEntry(this.callbacks.now(), section, p.name, to));
    const now = (): number[] => this.callbacks.now().tables[section][p.name] as number[];
    const more = h(
      "button",
      { type: "button", onclick: () => set([...now(), 0]) },
      "Add a coefficient",
    );
    const less = h(
      "button",
      {
        type: "button",
        disabled: values.length < 2,
        title: values.length < 2 ? "At least one coefficient is required." : "",
        onclick: () => set(now().slice(0, -1)),
      },
      "Remove the last coefficient",
    );
    return [...fields, h("div", { className: "row" }, more, less)];
  }

  private text(section: string, p: ParameterInfo, values: number[]): HTMLElement {
    const id = unique();
    const area = h("textarea", { id, rows: 4, spellcheck: false, value: values.join(", ") });
    area.addEventListener("change", () => {
      const numbers = area.value
        .split(/[\s,;]+/)
        .filter(Boolean)
        .map(Number);
      if (numbers.some(Number.isNaN))
        return this.showError({
          path: [],
          message: `${label(p.name)}: comma-separated numbers`,
        });
      this.last = `${section}.${p.name}`;
      this.settled(withEntry(this.callbacks.now(), section, p.name, numbers));
    });
    return h(
      "div",
      { className: "field", title: p.description },
      h("label", { htmlFor: id }, label(p.name)),
      h("span", { className: "unit" }, p.unit),
      area,
    );
  }

  private words(section: string, p: ParameterInfo, value: string): HTMLElement {
    const select = choice(p.choices, (to) =>
      this.settled(withEntry(this.callbacks.now(), section, p.name, to)),
    );
    select.value = value;
    return labelledField(label(p.name), select);
  }

  private distance(design: Design): HTMLElement[] {
    if (design.tables.lens.kind === "orthographic") return [];
    const [p] = this.parts.mount.parameters;
    const value = design.tables.mount.mirror_distance_mm as number;
    const field = this.number("mount.mirror_distance_mm", p, "Distance", value);
    const isMapped = "theta_max_deg" in design.tables.mirror && !design.tables.secondary;
    field.classList.toggle("led", design.follows_mapping);
    return [field, ...(isMapped ? [check(this.follows, "Lens position follows the mapping")] : [])];
  }

  private second(table: Tables): HTMLElement[] {
    const kind = kindOf(this.parts.secondaries, table);
    return [
      h("p", { className: "words" }, `${kind.kind}`),
      ...this.of("secondary", kind, table),
      ...this.of("secondary", this.parts.secondary_position, table),
    ];
  }

  /** Create the fields for the misalignment of the mirror, and a button that resets it. */
  private pose(table: Tables): HTMLElement[] {
    const fields = this.parts.pose.parameters.flatMap((p) =>
      this.entry("mirror_pose", p, table[p.name] ?? 0),
    );
    const back = (): void => {
      const { mirror_pose: _, ...tables } = this.callbacks.now().tables;
      this.settled({ ...this.callbacks.now(), tables });
    };
    return [
      ...fields,
      h(
        "div",
        { className: "row" },
        h("button", { type: "button", onclick: back }, "Align the mirror"),
      ),
    ];
  }

  private name(design: Design): HTMLElement {
    const input = h("input", {
      type: "text",
      id: unique(),
      maxLength: 60,
      value: nameOf(design),
      spellcheck: false,
    });
    input.addEventListener("change", () => {
      const now = this.callbacks.now();
      this.settled({ ...now, tables: { ...now.tables, name: input.value.trim() || "design" } });
    });
    this.named = input;
    return h("div", { className: "field" }, h("label", { htmlFor: input.id }, "Name"), input);
  }

  private focus(): HTMLElement {
    return h(
      "div",
      { className: "row" },
      h(
        "button",
        {
          type: "button",
          onclick: () => this.callbacks.change("focus", "worst_floored_area_deg2"),
          title: "Minimise the maximum floored blur area",
        },
        "Best focus",
      ),
    );
  }

  private objects(design: Design): HTMLElement[] {
    const far = check(this.infinite, "At infinity");
    return design.distance === null
      ? [far]
      : [this.number(DISTANCE, FAR, "Object distance", design.distance), far];
  }

  /** Return the properties of a design that determine the set of fields. */
  private shapeOf({ tables, follows_mapping, distance }: Design): string {
    const of = (part: PartInfo, table: Tables): unknown =>
      part.parameters.map((p) =>
        Array.isArray(table[p.name])
          ? (table[p.name] as number[]).length
          : (table[p.name] ?? p.default) === null,
      );
    const second = tables.secondary as Tables | undefined;
    const parts = [
      of(kindOf(this.parts.mirrors, tables.mirror), tables.mirror),
      second && of(kindOf(this.parts.secondaries, second), second),
      of(kindOf(this.parts.lenses, tables.lens), tables.lens),
    ];
    return JSON.stringify([
      tables.mirror.kind,
      second?.kind,
      tables.mirror_pose !== undefined,
      tables.lens.kind,
      parts,
      follows_mapping,
      distance === null,
    ]);
  }

  private settled(design: Design): void {
    this.callbacks.edit(design);
    this.callbacks.settle();
  }

  private rim(): number {
    const { mirror } = this.callbacks.now().tables;
    return Math.round((mirror.rim_radius_mm as number | undefined) ?? 50);
  }
}

const kindOf = (all: PartInfo[], table: Tables): PartInfo =>
  all.find((p) => p.kind === table.kind)!;

function valueAt(design: Design, key: string): number | undefined {
  if (key === DISTANCE) return design.distance ?? undefined;
  const [section, name, index] = key.split(".");
  const value = (design.tables[section] as Tables | undefined)?.[name] as unknown;
  return (index === undefined ? value : (value as number[] | undefined)?.[Number(index)]) as
    number | undefined;
}

function changedAt(design: Design, key: string, value: number): Design {
  if (key === DISTANCE) return { ...design, distance: value };
  const [section, name, index] = key.split(".");
  const changed = withEntry(
    design,
    section,
    name,
    value,
    index === undefined ? undefined : Number(index),
  );
  return key === "mount.mirror_distance_mm" ? { ...changed, follows_mapping: false } : changed;
}

function choice(values: readonly string[], chosen: (value: string) => void): HTMLSelectElement {
  const select = h(
    "select",
    {},
    ...values.map((value) => h("option", { value }, value.replaceAll("-", " "))),
  );
  select.addEventListener("change", () => chosen(select.value));
  return select;
}

const check = (box: HTMLInputElement, title: string): HTMLElement =>
  h("label", { className: "check" }, box, title);
