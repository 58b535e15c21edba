import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { h, reveal, save, unique } from "../../shared/dom";
import type {
  ExportableFile,
  ExportStart,
  ExportStatus,
  ExportTask,
  TolerancePlanMessage,
  WorkshopEntry,
} from "../../shared/messages";
import type { Design } from "../model/design";
import {
  entered,
  storedWorkshop,
  storeWorkshop,
  type Workshop,
  workshopOf,
} from "../model/workshop";
import { unitWords } from "../labels";
import * as supply from "../data_source";

interface Callbacks {
  now: () => Design;
  /** Tolerances of the tolerance panel; null if it is closed. */
  tolerances: () => TolerancePlanMessage | null;
  fail: (e: unknown) => void;
}

const IMMEDIATE = ["sensor", "evaluation", "requirements"]; // files that require no worker process

/** Dialog for the export of files, with the workshop data of drawings. */
export class ExportDialog {
  private readonly task = new api.ServerTask<ExportStatus>();
  private readonly heading = h("h2", { id: unique() }, "Export");
  private readonly body = h("div", { className: "export-body" });
  private readonly bar = h("progress", { max: 1, hidden: true, "aria-label": "Export" });
  private readonly status = h("p", { className: "words", role: "status" });
  private readonly remarks = h("ul", { className: "words remarks" });
  private readonly problem = h("p", { className: "problem", role: "alert", hidden: true });
  private readonly archive = h(
    "button",
    { type: "button", className: "primary", onclick: () => this.exportArchive() },
    "Download ZIP archive",
  );
  private readonly cancel = h(
    "button",
    { type: "button", hidden: true, onclick: () => this.stop("Export cancelled.") },
    "Cancel export",
  );
  private readonly dialog = h(
    "dialog",
    { className: "export", "aria-labelledby": this.heading.id },
    h(
      "div",
      { className: "row" },
      this.heading,
      h("button", { type: "button", onclick: () => this.dialog.close() }, "Close"),
    ),
    this.body,
    h("div", { className: "row" }, this.archive, this.cancel),
    this.bar,
    this.status,
    this.problem,
    this.remarks,
  );
  private readonly useTolerances = h("input", { type: "checkbox" });
  private start: ExportStart | null = null;
  private workshop: Workshop = workshopOf(storedWorkshop());
  private readonly boxes = new Map<string, HTMLInputElement>();
  private readonly inputs = new Map<string, HTMLInputElement>();
  private readonly problems = new Map<string, HTMLElement>();
  private buttons: HTMLButtonElement[] = [];

  constructor(
    place: HTMLElement,
    private readonly callbacks: Callbacks,
  ) {
    this.dialog.addEventListener("close", () => this.task.isActive && this.stop(""));
    place.append(this.dialog);
  }

  /** Open the dialog for the current design. */
  async open(): Promise<void> {
    try {
      this.start ??= await api.exportStart();
    } catch (e) {
      return this.callbacks.fail(e);
    }
    this.build(this.start);
    this.stop("");
    this.dialog.showModal();
  }

  private build({ formats, workshop, remedy }: ExportStart): void {
    const { tables, requirements } = this.callbacks.now();
    const missing = formats.filter((f) => f.missing.length);
    this.buttons = [];
    const chosen = new Map([...this.boxes].map(([name, box]) => [name, box.checked]));
    const available = formats.filter((f) => f.name !== "requirements" || requirements);
    const plan = this.callbacks.tolerances();
    this.useTolerances.disabled = plan === null;
    if (plan === null) this.useTolerances.checked = false;
    this.body.replaceChildren(
      ...(missing.length
        ? [
            h(
              "p",
              { className: "problem" },
              `${missing.map((f) => f.title).join(", ")}: not available, because ${[...new Set(missing.flatMap((f) => f.missing))].join(", ")} is not installed; ${remedy}`,
            ),
          ]
        : []),
      h(
        "fieldset",
        { className: "formats" },
        h("legend", {}, "Files"),
        ...available.map((f) => this.format(f, chosen.get(f.name) ?? f.is_for_manufacturing)),
      ),
      h(
        "label",
        {
          className: "check",
          title:
            plan === null
              ? "Set the errors in the Tolerances panel first."
              : "In drawings and in the tolerance report",
        },
        this.useTolerances,
        "Use the tolerances of the Tolerances panel (otherwise medium grade in the report)",
      ),
      ...workshop
        .filter((section) => section.name !== "secondary" || tables.secondary)
        .map((section) =>
          h(
            "fieldset",
            { className: "workshop" },
            h("legend", {}, section.title),
            ...section.entries.map((entry) => this.entry(section.name, entry)),
          ),
        ),
    );
  }

  private format({ name, title, missing }: ExportableFile, isChosen: boolean): HTMLElement {
    const box = h("input", {
      type: "checkbox",
      checked: isChosen && !missing.length,
      disabled: missing.length > 0,
    });
    this.boxes.set(name, box);
    const button = h(
      "button",
      {
        type: "button",
        className: "small",
        disabled: missing.length > 0,
        "aria-label": `Download ${title}`,
        onclick: () => background(this.exportFile(name)),
      },
      "Download",
    );
    this.buttons.push(button);
    return h(
      "div",
      { className: "format" },
      h("label", { className: "check" }, box, title),
      button,
    );
  }

  private entry(section: string, entry: WorkshopEntry): HTMLElement {
    const id = unique();
    const key = `${section}.${entry.name}`;
    const isText = entry.max_length !== null;
    const value = this.workshop[section]?.[entry.name] ?? entry.default;
    const input = h("input", {
      id,
      type: isText ? "text" : "number",
      value: value === null ? "" : String(value),
      title: entry.description,
      ...(isText
        ? { maxLength: entry.max_length, placeholder: entry.description }
        : { step: "any", min: String(entry.low), max: String(entry.high) }),
      "aria-describedby": `${id}p`,
    });
    input.addEventListener("change", () => this.enter(section, entry, input));
    const problem = h("p", { id: `${id}p`, className: "problem", hidden: true });
    this.inputs.set(key, input);
    this.problems.set(key, problem);
    return h(
      "div",
      { className: "field" },
      h("label", { htmlFor: id }, entry.label),
      h(
        "span",
        { className: "entry" },
        input,
        h("span", { className: "unit" }, unitWords(entry.unit)),
      ),
      problem,
    );
  }

  private enter(section: string, entry: WorkshopEntry, input: HTMLInputElement): void {
    this.workshop = {
      ...this.workshop,
      [section]: { ...this.workshop[section], [entry.name]: entered(entry, input.value) },
    };
    storeWorkshop(this.workshop);
  }

  private async exportFile(name: string): Promise<void> {
    if (!IMMEDIATE.includes(name)) return this.run([name], false);
    const { tables, requirements, distance } = this.callbacks.now();
    try {
      if (name === "requirements")
        save(await api.requirements({ tables, requirements: requirements! }), "requirements.toml");
      else {
        const kind = name === "sensor" ? "sensor" : "table";
        const file = await supply.download({ tables, kind, object_distance_mm: distance });
        save(file.blob, file.name);
      }
      this.stop("");
    } catch (e) {
      if (!api.isUserError(e)) throw e;
      this.stop("", e.message);
    }
  }

  private exportArchive(): void {
    const names = [...this.boxes].filter(([, box]) => box.checked && box.isConnected);
    if (!names.length) return this.stop("", "Select at least one file.");
    this.run(
      names.map(([name]) => name),
      true,
    );
  }

  private run(formats: string[], isArchive: boolean): void {
    const { tables, requirements, distance } = this.callbacks.now();
    const task: ExportTask = {
      tables,
      requirements,
      object_distance_mm: distance,
      formats,
      is_archive: isArchive,
      workshop: tables.secondary ? this.workshop : { ...this.workshop, secondary: {} },
      tolerances: this.useTolerances.checked ? this.callbacks.tolerances() : null,
    };
    let name = "";
    this.stop("Starting…");
    this.showRunning(true);
    this.task.begin(
      "api/design/export/run",
      [task],
      (status) => {
        name = status.name ?? name;
        this.onStatus(status);
      },
      () => this.stop("", "The export was interrupted."),
      (blob) => {
        save(blob, name);
        this.task.end();
        this.showRunning(false);
      },
    );
  }

  private onStatus({ state, message, fraction, entry, remarks }: ExportStatus): void {
    if (state === "failed") {
      this.stop("", entry ? "" : message);
      if (entry) this.showEntryError(entry, message);
      return;
    }
    if (fraction === null) this.bar.removeAttribute("value");
    else this.bar.value = fraction;
    this.status.textContent =
      state === "running" ? `${message}: ${Math.round(100 * (fraction ?? 0))} %` : message;
    this.remarks.replaceChildren(...remarks.map((remark) => h("li", {}, remark)));
  }

  /** Display the error of an entry of the workshop data at its field, with its label. */
  private showEntryError([section, name]: [string, string], message: string): void {
    const key = `${section}.${name}`;
    const all = this.start!.workshop.find((s) => s.name === section)?.entries ?? [];
    const label = all.find((e) => e.name === name)?.label ?? name;
    const text = message.startsWith(`${name} `) ? label + message.slice(name.length) : message;
    const problem = this.problems.get(key);
    if (!problem?.isConnected) return this.stop("", text);
    problem.textContent = text;
    problem.hidden = false;
    this.inputs.get(key)!.setAttribute("aria-invalid", "true");
    this.inputs.get(key)!.focus();
  }

  private stop(message: string, problem = ""): void {
    this.task.end();
    this.showRunning(false);
    this.status.textContent = message;
    this.problem.textContent = problem;
    reveal(this.problem, problem !== "");
    this.remarks.replaceChildren();
    for (const [key, element] of this.problems) {
      element.hidden = true;
      this.inputs.get(key)!.removeAttribute("aria-invalid");
    }
  }

  private showRunning(isRunning: boolean): void {
    this.cancel.hidden = this.bar.hidden = !isRunning;
    this.archive.disabled = isRunning;
    for (const button of this.buttons) {
      const isMissing = button.parentElement?.querySelector("input")?.disabled ?? false;
      button.disabled = isRunning || isMissing;
    }
    this.bar.removeAttribute("value");
  }
}
