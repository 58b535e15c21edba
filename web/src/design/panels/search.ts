import { ServerTask } from "../../shared/api";
import { h, labelledField, reveal, unique, write } from "../../shared/dom";
import type {
  DesignSensor,
  DesignStart,
  RelaxationOption,
  TaskStatus,
  SearchTask,
} from "../../shared/messages";
import { words } from "../../shared/numbers";
import type { Design, Tables } from "../model/design";
import { limitsOf } from "../model/requirements";
import { labelledMessage, quantityWords, unitWords } from "../labels";

interface Callbacks {
  now: () => Design;
  /** Load the result of an optimisation (`isOptimised`) or of a design. */
  take: (result: DesignSensor, isOptimised: boolean) => void;
  /** Replace the requirements. */
  relax: (requirements: Tables) => void;
}

/** Long-running searches: mirror optimisation, and design from requirements. */
export class WorkPanel {
  private readonly task = new ServerTask<TaskStatus>();
  private readonly merit: HTMLSelectElement;
  private readonly shape: HTMLSelectElement;
  private readonly terms = h("input", {
    type: "number",
    min: "3",
    max: "32",
    step: "1",
    value: "8",
  });
  private readonly starts = h("input", {
    type: "number",
    min: "1",
    max: "8",
    step: "1",
    value: "2",
  });
  private readonly keeps = h("input", { type: "checkbox", checked: true });
  private readonly keepsLabel = h(
    "label",
    {
      className: "check",
      title: "Search among mirrors that meet the limits; report if none does",
      hidden: true,
    },
    this.keeps,
    "Enforce the limits of the requirements",
  );
  private readonly begin = h(
    "button",
    { type: "button", onclick: () => this.start("optimise") },
    "Optimise",
  );
  private readonly design = h(
    "button",
    { type: "button", onclick: () => this.start("design") },
    "Design from requirements",
  );
  private readonly cancel = h(
    "button",
    {
      type: "button",
      hidden: true,
      onclick: () =>
        this.stop(
          this.isLoaded
            ? "The search for relaxations was cancelled."
            : "Cancelled; the design is unchanged.",
        ),
    },
    "Cancel",
  );
  private readonly reason = h("p", { className: "words", id: unique(), hidden: true });
  private readonly bar = h("progress", { max: 1, hidden: true, "aria-label": "Search" });
  private readonly status = h("p", { className: "words", role: "status" });
  private readonly relaxations = h("div", { className: "relaxations" });
  private kind: SearchTask["kind"] = "optimise";
  /** Whether the design is loaded, and relaxations are searched. */
  private isLoaded = false;

  constructor(
    place: HTMLElement,
    private readonly parts: DesignStart,
    private readonly callbacks: Callbacks,
  ) {
    this.merit = h(
      "select",
      {},
      ...parts.merits.map((m) =>
        h("option", { value: m.name, title: m.meaning }, quantityWords(m)),
      ),
    );
    this.shape = h(
      "select",
      {},
      ...parts.shapes.map((f) => h("option", { value: f }, f.replaceAll("-", " "))),
    );
    this.begin.setAttribute("aria-describedby", this.reason.id);
    place.append(
      labelledField("Minimise", this.merit),
      labelledField("Freeform surface", this.shape),
      labelledField("Coefficients", this.terms),
      labelledField("Number of starts", this.starts),
      this.keepsLabel,
      h("div", { className: "row" }, this.begin, this.design, this.cancel),
      this.reason,
      this.bar,
      this.status,
      this.relaxations,
    );
  }

  /** Enable the searches for a design; `reason` is set if its mirror cannot be optimised. */
  show(design: Design, reason: string | null): void {
    reveal(this.design, Boolean(design.requirements?.mirror));
    reveal(this.keepsLabel, limitsOf(design.requirements).length > 0);
    reveal(this.reason, reason !== null);
    write(this.reason, reason ?? "");
    this.begin.disabled = this.task.isActive || reason !== null;
  }

  private start(kind: SearchTask["kind"]): void {
    const { tables, requirements, distance } = this.callbacks.now();
    this.kind = kind;
    this.isLoaded = false;
    const task: SearchTask = {
      kind,
      tables,
      requirements,
      object_distance_mm: distance,
      merit: this.merit.value,
      shape: this.shape.value,
      terms: Number(this.terms.value),
      starts: Number(this.starts.value),
      keeps_limits: this.keeps.checked,
    };
    const onInterruption = () => this.stop("The search was interrupted; the design is unchanged.");
    this.task.begin("api/design/work", [task], (status) => this.onStatus(status), onInterruption);
    this.relaxations.replaceChildren();
    this.running(true);
    this.status.textContent = "Starting…";
  }

  private onStatus(status: TaskStatus): void {
    if (status.sensor && !this.isLoaded) {
      this.isLoaded = true;
      this.callbacks.take(status.sensor, this.kind === "optimise");
    }
    if (status.state === "running" || status.state === "waiting") {
      if (status.fraction === null) this.bar.removeAttribute("value");
      else this.bar.value = status.fraction;
      const merit = this.parts.merits.find((m) => m.name === this.merit.value)!;
      const value =
        status.value === null
          ? ""
          : `: ${words(status.value, 5)} ${unitWords(merit.unit)}`.trimEnd();
      this.status.textContent = `${this.labelled(status.message)}${value}`;
      return;
    }
    this.stop(this.labelled(status.message));
    this.showRelaxations(status.relaxations);
  }

  /** Display the relaxations; a click applies one and repeats the design. */
  private showRelaxations(options: readonly RelaxationOption[]): void {
    if (!options.length) return;
    const rows = options.map(({ values, requirements }) => {
      const texts = values.map(({ name, unit, requested, needed }) =>
        `${this.labelled(name)} ${short(requested)} → ${short(needed)} ${unitWords(unit)}`
          .trimEnd()
          .replace(" °", "°"),
      );
      const apply = (): void => {
        this.callbacks.relax(requirements);
        this.start("design");
      };
      const button = h(
        "button",
        {
          type: "button",
          className: "small",
          "aria-label": `Apply: ${texts.join(", ")}`,
          title: "Change the requirements, and design the sensor again",
          onclick: apply,
        },
        "Apply",
      );
      return h("li", {}, h("span", {}, texts.join(" and ")), button);
    });
    this.relaxations.replaceChildren(
      h("p", { className: "words" }, "All requirements can be met with one of these changes:"),
      h("ul", {}, ...rows),
    );
  }

  private labelled(message: string): string {
    return labelledMessage(message, this.parts.quantities);
  }

  private stop(message: string): void {
    this.task.end();
    this.relaxations.replaceChildren();
    this.running(false);
    this.status.textContent = message;
  }

  private running(isRunning: boolean): void {
    this.begin.disabled = isRunning || !this.reason.hidden;
    this.design.disabled = isRunning;
    this.cancel.hidden = this.bar.hidden = !isRunning;
    this.bar.removeAttribute("value");
  }
}

const short = (value: number): string => String(Number(value.toPrecision(5))).replace("-", "−");
