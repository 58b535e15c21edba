import { background } from "../shared/background";
import { allow, h, save } from "../shared/dom";
import { checkReadable } from "../shared/media";
import type { DesignSensor } from "../shared/messages";
import type { Design, Tables } from "./model/design";
import type { Host } from "./host";
import * as supply from "./data_source";

/** Interface of the Design tab for the toolbar. */
interface Callbacks {
  sensors: readonly string[];
  history: { now: Design; canUndo: boolean; canRedo: boolean };
  undo: () => void;
  redo: () => void;
  pin: () => void;
  take: (sensor: DesignSensor, words: string) => void;
  takeRequirements: (requirements: Tables) => void;
  openExport: () => void;
  fail: (e: unknown) => void;
}

/** Toolbar of the Design tab in the page header. */
export class Toolbar {
  private readonly undo = h("button", {
    type: "button",
    title: "Undo (Ctrl+Z)",
    "aria-label": "Undo",
    className: "undo",
    onclick: () => this.tab.undo(),
  });
  private readonly redo = h("button", {
    type: "button",
    title: "Redo (Ctrl+Shift+Z)",
    "aria-label": "Redo",
    className: "redo",
    onclick: () => this.tab.redo(),
  });
  private readonly file = h("input", {
    type: "file",
    accept: ".toml",
    hidden: true,
    "aria-label": "Sensor or requirement file",
    id: "design-file",
  });

  constructor(
    private readonly host: Host,
    private readonly tab: Callbacks,
  ) {
    this.file.addEventListener("change", () => {
      const [file] = this.file.files ?? [];
      if (file) background(this.open(file, file.name));
      this.file.value = "";
    });
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
        h("button", { type: "button", onclick: () => tab.pin() }, "Pin"),
        h(
          "button",
          {
            type: "button",
            title: "Files for manufacturing, lens files, tables and reports",
            "data-computes": "",
            onclick: () => tab.openExport(),
          },
          "Export…",
        ),
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
    this.bindDropping();
  }

  show(): void {
    allow(this.undo, this.tab.history.canUndo ? null : "There is no change to undo.");
    allow(this.redo, this.tab.history.canRedo ? null : "There is no change to redo.");
  }

  /** Open a sensor file or a requirement file. */
  async open(file: Blob, name: string): Promise<void> {
    await this.try(async () => {
      await checkReadable(file, name);
      const { sensor, requirements } = await supply.openFile(file, name);
      if (sensor) this.tab.take(sensor, `${name} loaded`);
      if (!requirements) return;
      this.tab.takeRequirements(requirements);
      this.host.say(
        requirements.mirror
          ? `${name}: requirements loaded; Design from requirements searches for a design`
          : `${name}: requirements loaded`,
      );
    });
  }

  /** Save the sensor file. */
  async saveSensor(): Promise<void> {
    await this.try(async () => {
      const { blob, name } = await this.sensorFile();
      save(blob, name);
    });
  }

  private sensorFile(): Promise<{ blob: Blob; name: string }> {
    const { tables, distance } = this.tab.history.now;
    return supply.download({ tables, kind: "sensor", object_distance_mm: distance });
  }

  private async look(): Promise<void> {
    await this.try(async () => {
      const { blob, name } = await this.sensorFile();
      await this.host.lookThrough(blob, name);
    });
  }

  private starts(): HTMLElement {
    const select = h(
      "select",
      { "aria-label": "Start from a bundled sensor" },
      h("option", { value: "" }, "Start from…"),
      ...this.tab.sensors.map((name) => h("option", { value: name }, name)),
    );
    select.addEventListener("change", () => {
      const name = select.value;
      select.value = "";
      background(this.try(async () => this.tab.take(await supply.bundled(name), "")));
    });
    return select;
  }

  private async try(act: () => Promise<void>): Promise<void> {
    try {
      await act();
    } catch (e) {
      this.tab.fail(e);
    }
  }

  /** Open files that are dropped in the Design tab. */
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
