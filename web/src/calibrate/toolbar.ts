import { h, save } from "../shared/dom";
import type { CalibrationResult } from "../shared/messages";
import type { Host } from "./host";

interface Callbacks {
  add: (files: readonly File[]) => void;
  webcam: () => void;
  clear: () => void;
  result: () => CalibrationResult | null;
  report: () => string | null;
  look: () => void;
}

/** Toolbar of the tab in the page header; files dropped on the tab are added to the images. */
export class Toolbar {
  private readonly file = h("input", {
    type: "file",
    multiple: true,
    accept: "image/*,video/*,.tif,.tiff",
    hidden: true,
    "aria-label": "Images or a video of a target",
    id: "calibrate-files",
  });
  private readonly clear = h("button", { type: "button" }, "Clear");
  private readonly keep: HTMLElement;
  private readonly report = h(
    "button",
    { type: "button", title: "Download the calibration report" },
    "Report",
  );

  constructor(
    private readonly host: Host,
    private readonly callbacks: Callbacks,
  ) {
    this.file.addEventListener("change", () => {
      callbacks.add([...(this.file.files ?? [])]);
      this.file.value = "";
    });
    this.clear.addEventListener("click", () => callbacks.clear());
    this.report.addEventListener("click", () =>
      this.download(callbacks.report(), "calibration.html", "text/html"),
    );
    const camera = h(
      "button",
      {
        type: "button",
        title: "Download the camera file for the command line",
        onclick: () =>
          this.download(callbacks.result()?.camera_file ?? null, "camera.toml", "application/toml"),
      },
      "Camera file",
    );
    const look = h(
      "button",
      { type: "button", className: "primary", onclick: () => callbacks.look() },
      "Use as camera",
    );
    this.keep = nav("Export the camera", "keep", camera, this.report, look);
    host.header.append(
      nav(
        "Images of a target",
        "",
        h("button", { type: "button", onclick: () => this.open() }, "Add images…"),
        h("button", { type: "button", onclick: () => callbacks.webcam() }, "Webcam"),
        this.clear,
        this.file,
      ),
      this.keep,
    );
    this.bindDropping();
  }

  open(): void {
    this.file.click();
  }

  show(hasPictures: boolean): void {
    this.clear.hidden = !hasPictures;
    this.keep.hidden = this.callbacks.result() === null;
    const isMade = this.callbacks.report() !== null;
    this.report.disabled = !isMade;
    this.report.textContent = isMade ? "Report" : "Writing the report…";
  }

  private download(text: string | null, name: string, type: string): void {
    if (text !== null) save(new Blob([text], { type }), name);
  }

  private bindDropping(): void {
    document.addEventListener(
      "drop",
      (e) => {
        const files = [...(e.dataTransfer?.files ?? [])];
        if (!this.host.isShown() || !files.length) return;
        e.preventDefault();
        e.stopImmediatePropagation();
        this.callbacks.add(files);
      },
      { capture: true },
    );
  }
}

const nav = (title: string, className: string, ...children: HTMLElement[]): HTMLElement =>
  h("nav", { "aria-label": title, className, "data-tab": "calibrate" }, ...children);
