import { background } from "../shared/background";
import * as api from "../shared/api";
import { allow, h, save } from "../shared/dom";
import { checkReadable } from "../shared/media";
import type { BenchSensor, FileRequest } from "../shared/messages";
import type { Design, Tables } from "./model/design";
import type { Host } from "./host";
import * as supply from "./data_source";

const ASKED_EVERY_MS = 400; // interval of progress requests, ms
const FILES: [FileRequest["kind"], string][] = [
  ["sensor", "Sensor file (TOML)"],
  ["report", "Report (HTML)"],
  ["drawing", "Drawing (PDF)"],
  ["table", "Evaluation (CSV)"],
  ["sag", "Sag table (CSV)"],
];

/** Interface of the bench for the toolbar. */
interface Callbacks {
  sensors: readonly string[];
  history: { now: Design; canUndo: boolean; canRedo: boolean };
  undo: () => void;
  redo: () => void;
  pin: () => void;
  take: (sensor: BenchSensor, words: string) => void;
  takeRequirements: (requirements: Tables) => void;
  fail: (e: unknown) => void;
}

/** Toolbar of the bench in the page header. */
export class Toolbar {
  private readonly undo = h("button", {
    type: "button",
    title: "Undo (Ctrl+Z)",
    "aria-label": "Undo",
    className: "undo",
    onclick: () => this.bench.undo(),
  });
  private readonly redo = h("button", {
    type: "button",
    title: "Redo (Ctrl+Shift+Z)",
    "aria-label": "Redo",
    className: "redo",
    onclick: () => this.bench.redo(),
  });
  private readonly file = h("input", {
    type: "file",
    accept: ".toml",
    hidden: true,
    "aria-label": "Sensor or requirement file",
    id: "design-file",
  });
  private readonly menu = h("details", { className: "menu", "data-computes": "" });
  private readonly summary = h("summary", { role: "button" }, "Download");
  private readonly requirements = h(
    "button",
    { type: "button", onclick: () => background(this.downloadRequirements()) },
    "Requirements (TOML)",
  );

  constructor(
    private readonly host: Host,
    private readonly bench: Callbacks,
  ) {
    this.file.addEventListener("change", () => {
      const [file] = this.file.files ?? [];
      if (file) background(this.open(file, file.name));
      this.file.value = "";
    });
    const items = FILES.map(([kind, title]) =>
      h("button", { type: "button", onclick: () => background(this.download(kind)) }, title),
    );
    this.menu.append(this.summary, h("div", { className: "items" }, ...items, this.requirements));
    const nav = (title: string, className: string, ...children: (Node | string)[]): HTMLElement =>
      h("nav", { "aria-label": title, className, "data-tab": "design" }, ...children);
    host.header.append(
      nav(
        "Design",
        "",
        this.undo,
        this.redo,
        h(
          "button",
          {
            type: "button",
            title: "Open a sensor file or a requirement file",
            "data-computes": "",
            onclick: () => this.file.click(),
          },
          "Open sensor…",
        ),
        this.starts(),
        this.file,
      ),
      nav(
        "Export the design",
        "keep",
        h("button", { type: "button", onclick: () => bench.pin() }, "Pin"),
        this.menu,
        h(
          "button",
          {
            type: "button",
            className: "primary",
            "data-computes": "",
            onclick: () => background(this.look()),
          },
          "Use as camera",
        ),
      ),
    );
    document.addEventListener(
      "click",
      (e) => !this.menu.contains(e.target as Node) && (this.menu.open = false),
    );
    this.menu.addEventListener("keydown", (e) => e.key === "Escape" && (this.menu.open = false));
    this.bindDropping();
  }

  show(): void {
    allow(this.undo, this.bench.history.canUndo ? null : "There is no change to undo.");
    allow(this.redo, this.bench.history.canRedo ? null : "There is no change to redo.");
    this.requirements.hidden = this.bench.history.now.requirements === null;
  }

  /** Open a sensor file or a requirement file. */
  async open(file: Blob, name: string): Promise<void> {
    await this.try(async () => {
      await checkReadable(file, name);
      const { sensor, requirements } = await supply.openFile(file, name);
      if (sensor) this.bench.take(sensor, `${name} loaded`);
      if (!requirements) return;
      this.bench.takeRequirements(requirements);
      this.host.say(
        requirements.mirror
          ? `${name}: requirements loaded; Design from requirements searches for a design`
          : `${name}: requirements loaded`,
      );
    });
  }

  async download(kind: FileRequest["kind"]): Promise<void> {
    this.menu.open = false;
    const { tables, distance } = this.bench.history.now;
    if (this.summary.getAttribute("aria-busy") === "true")
      return this.host.say("The previous file is still being written");
    const request: FileRequest = { tables, kind, object_distance_mm: distance };
    const stop = this.telling(request);
    try {
      await this.try(async () => {
        const { blob, name } = await supply.download(request);
        save(blob, name);
      });
    } finally {
      stop();
    }
  }

  /** Display the progress of a file; reports take several seconds. */
  private telling(request: FileRequest): () => void {
    const busy = (isBusy: boolean, words: string, title = ""): void => {
      Object.assign(this.summary, { textContent: words, title });
      this.summary.setAttribute("aria-busy", String(isBusy));
    };
    let isMade = false;
    busy(true, "Writing the file…");
    const timer = setInterval(async () => {
      const now = await api.making(request).catch(() => null);
      if (now && !isMade)
        busy(true, `Writing the file: ${Math.round(100 * now.fraction)} %`, now.message);
    }, ASKED_EVERY_MS);
    return () => {
      isMade = true;
      clearInterval(timer);
      busy(false, "Download");
    };
  }

  private async downloadRequirements(): Promise<void> {
    this.menu.open = false;
    const { tables, requirements } = this.bench.history.now;
    await this.try(async () =>
      save(await api.requirements({ tables, requirements: requirements! }), "requirements.toml"),
    );
  }

  private async look(): Promise<void> {
    const { tables, distance } = this.bench.history.now;
    await this.try(async () => {
      const { blob, name } = await supply.download({
        tables,
        kind: "sensor",
        object_distance_mm: distance,
      });
      await this.host.lookThrough(blob, name);
    });
  }

  private starts(): HTMLElement {
    const select = h(
      "select",
      { "aria-label": "Start from a bundled sensor" },
      h("option", { value: "" }, "Start from…"),
      ...this.bench.sensors.map((name) => h("option", { value: name }, name)),
    );
    select.addEventListener("change", () => {
      const name = select.value;
      select.value = "";
      background(this.try(async () => this.bench.take(await supply.bundled(name), "")));
    });
    return select;
  }

  private async try(act: () => Promise<void>): Promise<void> {
    try {
      await act();
    } catch (e) {
      this.bench.fail(e);
    }
  }

  /** Open files that are dropped on the bench. */
  private bindDropping(): void {
    document.addEventListener(
      "drop",
      (e) => {
        const file = e.dataTransfer?.files[0];
        if (!this.host.isShown() || !file) return;
        e.preventDefault();
        e.stopImmediatePropagation();
        background(this.open(file, file.name));
      },
      { capture: true },
    );
  }
}
