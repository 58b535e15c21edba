import { fileWord as file, shellWord } from "../shared/shell";
import { storedOrientation } from "../shared/api";
import type { ViewRequest } from "../shared/messages";
import type { State } from "../shared/state";
import type { Feed } from "./feeds/feed";
import type { Camera } from "./geometry/camera";
import { domeEnd, elevations, groundScale, planetWidth, spanOf } from "./geometry/views";

const plain = (x: number, digits = 4): string => String(+x.toFixed(digits));

const set = (key: string, value: string): string[] => ["--set", `${key}=${value}`];

/** Return the file name of a sensor with a fitted circle. */
export const fittedName = (camera: Camera): string =>
  `${camera.model.name.replace(/[^\w.-]/g, "_")}-fitted.toml`;

/** Return true if the circle was fitted; the command then requires a sensor file written by the page. */
export const needsFile = (camera: Camera): boolean =>
  camera.model.kind === "sensor" && camera.isMoved;

/** Return the command line that renders the same image. */
export function commandOf(
  s: State,
  camera: Camera,
  feed: Feed,
  width: number,
  height: number,
): string {
  const words = [
    "omnimirror",
    "dewarp",
    file(feed.source),
    ...(storedOrientation ? set("input.stored_orientation", "true") : []),
    ...cameraWords(camera),
    ...viewWords(viewRequest(s, camera, width, height)),
  ];
  return [...words, "-o", `${s.mode}.${feed.moves ? "mp4" : "png"}`].map(shellWord).join(" ");
}

function cameraWords(camera: Camera): string[] {
  const { kind, options, mount, mount_in_file: own } = camera.model;
  const words = needsFile(camera)
    ? ["--sensor", file(fittedName(camera))]
    : [options[0], file(options[1]), ...options.slice(2)];
  if (kind === "ball") {
    const { u, v, radius } = camera.circle;
    const field = options[1].split(",")[3];
    words[1] = [...[u, v, radius].map((x) => plain(x, 3)), field].join(",");
  }
  if (needsFile(camera)) return words; // the file contains the mount
  if (mount.camera_looks !== own.camera_looks) words.push("--camera-looks", mount.camera_looks);
  if (mount.forward_azimuth_deg !== own.forward_azimuth_deg)
    words.push(...set("camera.forward_azimuth_deg", plain(mount.forward_azimuth_deg)));
  if (mount.image_flipped !== own.image_flipped)
    words.push(...set("camera.image_flipped", String(mount.image_flipped)));
  if (mount.pitch_deg !== own.pitch_deg || mount.roll_deg !== own.roll_deg)
    words.push(...set("camera.level", `${plain(mount.pitch_deg)},${plain(mount.roll_deg)}`));
  return words;
}

/** Values of parameters that do not apply to a view. */
const NONE = {
  tilt_deg: null,
  hfov_deg: null,
  span_deg: null,
  elevation_deg: null,
  omega_deg: null,
  pole: null,
  height_mm: null,
  mm_per_px: null,
  distance_mm: null,
};

/** Return the parameters of a view as in Python, with a size in pixels. */
export function viewRequest(s: State, camera: Camera, width: number, height: number): ViewRequest {
  const { pole } = camera.model;
  const aspect = width / height;
  const common = {
    ...NONE,
    view: s.mode,
    size: [width, height] as [number, number | null],
    pan_deg: s.pan,
    distance_mm: Number.isFinite(s.distance) ? s.distance : null,
  };
  switch (s.mode) {
    case "panorama": {
      const span_deg = spanOf(s, camera, aspect);
      return { ...common, span_deg, elevation_deg: elevations(s, camera, aspect) };
    }
    case "perspective":
      return { ...common, tilt_deg: s.tilt, hfov_deg: s.hfov };
    case "dome":
      return { ...common, omega_deg: [0, domeEnd(s, camera)], pole };
    case "planet":
      return { ...common, hfov_deg: planetWidth(s, camera, aspect), pole };
    case "ground": {
      const mm_per_px = groundScale(s, width, height);
      return { ...common, height_mm: s.height, mm_per_px, distance_mm: null };
    }
    case "mosaic":
      return { ...common, size: [width, null], tilt_deg: s.tilt, hfov_deg: s.hfov };
  }
}

/** Parameters in the order of the command line, and whether they are settings (--set). */
const ORDER = [
  ["pan_deg", false],
  ["span_deg", true],
  ["elevation_deg", false],
  ["tilt_deg", false],
  ["hfov_deg", false],
  ["omega_deg", true],
  ["pole", true],
  ["height_mm", true],
  ["mm_per_px", true],
  ["distance_mm", false],
] as const;

function viewWords(request: ViewRequest): string[] {
  const [width, height] = request.size;
  const words = ORDER.flatMap(([name, isSetting]) => {
    const value = request[name];
    if (value === null) return [];
    const text =
      typeof value === "string"
        ? value
        : name === "mm_per_px"
          ? String(value)
          : [value]
              .flat()
              .map((x) => plain(x))
              .join(":");
    return isSetting ? set(`view.${name}`, text) : [`--${name.replace("_", "-")}`, text];
  });
  return ["--view", request.view, ...words, "--size", `${width}x${height ?? ""}`];
}
