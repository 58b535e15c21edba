import { fileWord as file, shellWord } from "../shared/shell";
import { storedOrientation } from "../shared/api";
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
    ...viewWords(s, camera, width, height),
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

function viewWords(s: State, camera: Camera, width: number, height: number): string[] {
  const words = ["--view", s.mode, "--pan-deg", plain(s.pan)];
  const far = Number.isFinite(s.distance) ? ["--distance-mm", plain(s.distance)] : [];
  const size = ["--size", `${width}x${height}`];
  switch (s.mode) {
    case "panorama": {
      const range = elevations(s, camera, width / height)
        .map((x) => plain(x))
        .join(":");
      return [
        ...words,
        ...set("view.span_deg", plain(spanOf(s, camera, width / height))),
        "--elevation-deg",
        range,
        ...far,
        ...size,
      ];
    }
    case "perspective":
      return [...words, "--tilt-deg", plain(s.tilt), "--hfov-deg", plain(s.hfov), ...far, ...size];
    case "dome":
      return [
        ...words,
        ...set("view.omega_deg", `0:${plain(domeEnd(s, camera))}`),
        ...set("view.pole", camera.model.pole),
        ...far,
        ...size,
      ];
    case "planet":
      return [
        ...words,
        "--hfov-deg",
        plain(planetWidth(s, camera, width / height)),
        ...set("view.pole", camera.model.pole),
        ...far,
        ...size,
      ];
    case "ground":
      return [
        ...words,
        ...set("view.height_mm", plain(s.height)),
        ...set("view.mm_per_px", String(groundScale(s, width, height))),
        ...size,
      ];
    case "mosaic":
      return [
        ...words,
        "--tilt-deg",
        plain(s.tilt),
        "--hfov-deg",
        plain(s.hfov),
        ...far,
        "--size",
        `${width}x`,
      ];
  }
}
