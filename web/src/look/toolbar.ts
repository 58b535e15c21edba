import { background } from "../shared/background";
import * as api from "../shared/api";
import { byId, save } from "../shared/dom";
import { copy, fail, say } from "../shared/notices";
import type { Store } from "../shared/store";
import { fittedName, needsFile } from "./command";
import { identityIn } from "./feeds/image_storage";
import { withTexts } from "./feeds/png";
import type { Camera } from "./geometry/camera";
import type { SensorPanel } from "./panels/sensor";
import type { Sources } from "./sources";

/** Interface of the tab for the toolbar. */
interface Callbacks {
  sources: Sources;
  sensor: SensorPanel;
  /** Current camera with its fitted circle. */
  camera: () => Camera | null;
  /** Canvas with the current view; null without an image. */
  drawn: () => HTMLCanvasElement | null;
  /** Command lines of the displayed views, one per line. */
  commands: () => string;
}

/** Toolbar: opening and saving, in the page header, next to the command, and by drag and drop. */
export class Toolbar {
  constructor(
    private readonly store: Store,
    private readonly callbacks: Callbacks,
  ) {
    const { sources } = callbacks;
    const file = byId<HTMLInputElement>("file");
    for (const id of ["open", "choose"]) byId(id).addEventListener("click", () => file.click());
    file.addEventListener("change", () => {
      if (file.files?.[0]) background(sources.openFile(file.files[0], file.files[0].name));
      file.value = "";
    });
    for (const id of ["room", "try"])
      byId(id).addEventListener("click", () => background(sources.openRoom()));
    byId("sources").addEventListener("change", (e) =>
      background(sources.openServer((e.target as HTMLSelectElement).value)),
    );
    byId("snapshot").addEventListener("click", () => background(this.snapshot()));
    byId("link").addEventListener("click", () =>
      setTimeout(() => background(this.copyLink()), 200),
    ); // after the address is updated
    byId("whole-screen").addEventListener("click", () =>
      background(
        document.fullscreenElement
          ? document.exitFullscreen()
          : byId("stage")
              .requestFullscreen()
              .catch(() => say("This browser does not support full screen.")),
      ),
    );
    byId("copy-command").addEventListener("click", () =>
      background(copy(byId("command-line").textContent ?? "", "Command")),
    );
    byId("save-sensor").addEventListener("click", () => background(this.saveSensor()));
    byId("save-image").addEventListener(
      "click",
      () => sources.feed?.renderedFile && save(sources.feed.renderedFile, sources.feed.name),
    );
    this.bindDropping();
  }

  private bindDropping(): void {
    const frame = byId("frame");
    document.addEventListener("dragover", (e) => {
      e.preventDefault();
      frame.classList.add("dropping");
    });
    document.addEventListener(
      "dragleave",
      (e) => e.relatedTarget || frame.classList.remove("dropping"),
    );
    document.addEventListener("drop", (e) => {
      e.preventDefault();
      frame.classList.remove("dropping");
      const file = e.dataTransfer?.files[0];
      if (file) background(this.callbacks.sources.openFile(file, file.name));
    });
  }

  /** Copy the link, and report what it does not contain. */
  private async copyLink(): Promise<void> {
    const { source, sensor } = this.store.state;
    const missing = [
      identityIn(source)?.name,
      sensor.startsWith("file:") ? this.callbacks.camera()?.model.name : null,
    ]
      .filter(Boolean)
      .join(" and ");
    const rest = missing
      ? `. The link does not contain ${missing}; other browsers prompt for the file`
      : source.startsWith("webcam:")
        ? ". The link opens the webcam of the recipient"
        : "";
    await copy(location.href, "Link", rest);
  }

  private async snapshot(): Promise<void> {
    const canvas = this.callbacks.drawn(); // the drawing buffer is cleared after display
    if (!canvas) return;
    const png = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve, "image/png"));
    if (!png) return say("The browser could not create the image.");
    const texts = {
      Software: "omnimirror studio",
      Comment: this.callbacks.commands(),
      Source: this.callbacks.sources.feed?.name ?? "",
    };
    save(await withTexts(png, texts), `${this.store.state.mode}.png`);
  }

  /** Save the file of a sensor with a fitted circle, or of one created by the page. */
  private async saveSensor(): Promise<void> {
    const camera = this.callbacks.camera()!;
    const { createdFile } = this.callbacks.sensor;
    if (createdFile && !needsFile(camera)) return save(createdFile.blob, createdFile.name);
    const { u, v, radius } = camera.circle;
    const requested = {
      id: camera.model.id,
      mount: camera.model.mount,
      image_size: [...camera.size] as [number, number],
      centre_px: [u, v] as [number, number],
      rim_radius_px: radius,
    };
    try {
      save(
        new Blob([await api.sensorFile(requested)], { type: "application/toml" }),
        fittedName(camera),
      );
    } catch (e) {
      fail(e);
    }
  }
}
