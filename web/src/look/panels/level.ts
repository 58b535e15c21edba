import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { allow, byId, put } from "../../shared/dom";
import { busy, fail, say } from "../../shared/notices";
import { fixed } from "../../shared/numbers";
import type { State } from "../../shared/state";
import type { Store } from "../../shared/store";
import { type Feed, fileOf } from "../feeds/feed";
import type { Camera } from "../geometry/camera";
import { raised } from "../geometry/tilt";
import { panTiltOf, RAD, type Vec3 } from "../../shared/vectors";
import { elevations } from "../geometry/views";
import type { Place } from "../stage";
import type { SensorPanel } from "./sensor";
import { ViewMode } from "./view_mode";

const LOOKED_AT = 1440; // px, longer side of the analysed image

/** Levelling of a tilted sensor: points dragged in the view move to the line of the horizon. */
export class LevelPanel {
  private readonly mode: ViewMode;
  private readonly line = byId("horizon");
  private readonly finder = byId<HTMLButtonElement>("find-level");
  private current: { camera: Camera; feed: Feed } | null = null;
  /** Tilt before the horizon was dragged. */
  private before: Pick<State, "pitch" | "roll"> = { pitch: null, roll: null };

  constructor(
    private readonly store: Store,
    private readonly sensor: () => SensorPanel,
    changed: () => void,
  ) {
    this.mode = new ViewMode(byId("level"), byId("level-bar"), {
      start: () => {
        this.mode.begin();
        const { pitch, roll } = store.state;
        this.before = { pitch, roll };
        if (!isLevelled(store.state)) store.set({ mode: "panorama" });
        changed();
      },
      ended: (end) => {
        if (end === "cancelled") background(this.sensor().want(this.before));
        changed();
      },
    });
    this.finder.addEventListener("click", () => background(this.find()));
    byId("plumb").addEventListener("click", () =>
      background(this.sensor().want({ pitch: 0, roll: 0 })),
    );
  }

  /** Set the current image and camera. */
  follow(camera: Camera, feed: Feed): void {
    this.current = { camera, feed };
    const isKnown =
      camera.model.kind === "ball" ||
      (camera.model.kind === "sensor" && !camera.model.tables.lattice);
    allow(
      this.finder,
      isKnown
        ? null
        : "Automatic levelling requires a mirror ball or a sensor with an aligned mirror; drag the horizon instead.",
    );
  }

  /** Estimate the tilt from vertical edges; automatic calls apply reliable results only. */
  async find(isRequested = true): Promise<void> {
    if (!this.current) return say("Open an image first.");
    const { camera, feed } = this.current;
    busy("Detecting vertical edges…");
    try {
      const { image, scale } = await fileOf(feed, LOOKED_AT);
      const result = await api.level(askOf(camera, feed.name, scale), image);
      if (feed !== this.current?.feed) return;
      const isSure = result && (isRequested || result.is_reliable);
      if (!result || !isSure)
        return isRequested
          ? say("The image has too few vertical edges; drag the horizon instead.")
          : undefined;
      await this.sensor().want({
        pitch: +result.pitch_deg.toFixed(2),
        roll: +result.roll_deg.toFixed(2),
      });
      say(
        `Pitch ${fixed(result.pitch_deg, 1)}°, roll ${fixed(result.roll_deg, 1)}°, standard error ${fixed(Math.max(result.sigma_deg, 0.1), 1)}°, from ${result.vertical_edges} vertical edges`,
      );
    } catch (e) {
      if (isRequested) fail(e);
    } finally {
      busy(null);
    }
  }

  /** Return true if dragging moves the horizon. */
  isDragged(): boolean {
    return this.mode.isActive && isLevelled(this.store.state);
  }

  /** Move the point in one direction to the elevation of another. */
  drag(from: Vec3, to: Vec3): void {
    const mount = this.sensor().camera?.model.mount;
    if (!mount) return;
    const [{ pan, tilt }, after] = [panTiltOf(from), panTiltOf(to)];
    this.sensor().tilt(
      raised({ pitch: mount.pitch_deg, roll: mount.roll_deg }, pan, after.tilt - tilt),
    );
  }

  /** Draw the horizon line in the active view. */
  show(camera: Camera | null, canvas: HTMLElement, place: Place): void {
    const { pitch_deg: pitch, roll_deg: roll } = camera?.model.mount ?? {
      pitch_deg: 0,
      roll_deg: 0,
    };
    byId("plumb").hidden = pitch === 0 && roll === 0;
    put("level-words", `Pitch ${fixed(pitch, 1)}°, roll ${fixed(roll, 1)}°.`);
    this.line.hidden = !camera || !this.isDragged();
    if (this.line.hidden || !camera) return;
    const { left, top, width, height, state } = place;
    const share = heightOf(state, camera, width / height);
    this.line.hidden = !(share > 0 && share < 1);
    Object.assign(this.line.style, {
      top: `${canvas.offsetTop + top + share * height}px`,
      left: `${canvas.offsetLeft + left}px`,
      width: `${width}px`,
    });
  }
}

/** Request for a reduced copy of the displayed image. */
function askOf(
  { model, circle, size }: Camera,
  name: string,
  scale: number,
): Parameters<typeof api.level>[0] {
  const at = (c: number): number => (c + 0.5) / scale - 0.5;
  return {
    id: model.id,
    mount: { ...model.mount, pitch_deg: 0, roll_deg: 0 },
    image_size: size.map((side) => Math.max(1, Math.round(side / scale))) as [number, number],
    centre_px: [at(circle.u), at(circle.v)],
    rim_radius_px: circle.radius / scale,
    name,
  };
}

const isLevelled = (s: State): boolean => s.mode === "panorama" || s.mode === "perspective";

/** Return the relative height of the horizon in a view, from the top. */
function heightOf(s: State, camera: Camera, aspect: number): number {
  if (s.mode === "perspective")
    return 0.5 + (aspect / 2 / Math.tan((s.hfov * RAD) / 2)) * Math.tan(s.tilt * RAD);
  const [low, high] = elevations(s, camera, aspect);
  return high / (high - low);
}
