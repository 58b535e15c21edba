import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { byId, closeOutside, save } from "../../shared/dom";
import type { ImageExportRequest, ViewRequest } from "../../shared/messages";
import { busy, fail, say } from "../../shared/notices";
import { type CameraFeed, originalOf } from "../feeds/feed";

/** Displayed image with its camera, and the view. */
export interface DisplayedView extends CameraFeed {
  view: ViewRequest;
}

/** Menu that exports the view or a light probe from the original image, computed by the server. */
export class ExportMenu {
  private readonly menu = byId<HTMLDetailsElement>("export");
  private task: AbortController | null = null;

  constructor(private readonly displayed: () => DisplayedView | null) {
    this.menu.addEventListener("click", (e) => {
      const button = (e.target as Element).closest<HTMLButtonElement>("button[data-format]");
      if (!button) return;
      this.menu.open = false;
      const format = button.dataset.format as ImageExportRequest["format"];
      background(this.export(format, "probe" in button.dataset));
    });
    closeOutside(this.menu);
  }

  private async export(format: ImageExportRequest["format"], isProbe: boolean): Promise<void> {
    const displayed = this.displayed();
    if (!displayed) return;
    const { camera, feed, view } = displayed;
    this.task?.abort();
    const task = (this.task = new AbortController());
    busy(isProbe ? "Computing the light probe…" : "Dewarping the original image…", {
      cancel: () => task.abort(),
    });
    try {
      const { model, circle, size, isMoved } = camera;
      const request: ImageExportRequest = {
        id: model.id,
        mount: model.mount,
        image_size: [...size] as [number, number],
        centre_px: [circle.u, circle.v],
        rim_radius_px: circle.radius,
        is_fitted: isMoved,
        name: feed.name,
        format,
        view: isProbe ? null : view,
      };
      const { file, note } = await api.exportedImage(request, await originalOf(feed), task.signal);
      const stem = feed.name.replace(/\.[^.]*$/, "");
      const name = `${stem}-${isProbe ? "light-probe" : view.view}.${format}`;
      save(file, name);
      say(`${name}: ${note}`);
    } catch (e) {
      if (!task.signal.aborted) fail(e);
    } finally {
      if (this.task === task) busy(null);
    }
  }
}
