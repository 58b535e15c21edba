/** Texts about targets and images, and the equivalent command line. */
import type {
  BoardSpec,
  BoardDetection,
  CalibrationOptions,
  CalibrationRequest,
  DetectedOutline,
} from "../shared/messages";
import { words } from "../shared/numbers";

export const COUNTED: Record<BoardSpec["kind"], string> = {
  chessboard: "Inner corners",
  charuco: "Squares",
  aprilgrid: "Tags",
};
const MIN_IMAGES = 3;
const MAX_NAMED = 40; // maximum number of files on a command line; more are replaced by their folder

/** Return the displayed name of a camera model. */
export function modelWords(kind: string): string {
  const named: Record<string, string> = {
    auto: "Automatic",
    unified: "unified sphere",
    "enhanced-unified": "enhanced unified",
    sensor: "mirror sensor",
    "kannala-brandt": "Kannala-Brandt",
    ocam: "OCamCalib polynomial",
  };
  return named[kind] ?? kind.replaceAll("-", " ");
}

/** Camera models applicable to the optics. */
export const modelsFor = (
  start: CalibrationOptions,
  optics: CalibrationRequest["optics"],
): string[] => [
  "auto",
  ...start.models.filter((kind) => optics === "mirror" || !start.mirrors_only.includes(kind)),
];

/** Return the status text of an image. */
export function stateWords(detection: BoardDetection, reason: string | null): string {
  if (reason) return `${reason[0].toUpperCase()}${reason.slice(1)}`;
  return detection.ids.length === 1 ? "1 corner" : `${detection.ids.length} corners`;
}

/** Return the reason against a calibration; null if it is possible. */
export function whyNot(result: number, waiting: number): string | null {
  if (waiting)
    return `${waiting === 1 ? "One image has" : `${waiting} images have`} not been processed yet.`;
  if (result < MIN_IMAGES)
    return `The target was detected in ${result === 0 ? "no image" : result === 1 ? "one image" : `${result} images`}; at least ${MIN_IMAGES} are required, 10 to 20 are recommended.`;
  return null;
}

/** Return a unique name: a used name gets a number. */
export function unlike(name: string, used: ReadonlySet<string>): string {
  let unique = name;
  for (let count = 2; used.has(unique); count++) unique = `${name} (${count})`;
  return unique;
}

/** Return the median of the reliable rims of several images; null if there are too few. */
export function rimOf(
  result: readonly DetectedOutline[],
): { centre: [number, number]; radius: number } | null {
  const sure = result.filter((rim) => rim.is_reliable);
  if (!sure.length || sure.length * 2 < result.length) return null;
  const middle = (value: (rim: DetectedOutline) => number): number => {
    const sorted = sure.map(value).sort((a, b) => a - b);
    const half = Math.floor(sorted.length / 2);
    return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
  };
  const round = (x: number): number => Math.round(x * 100) / 100;
  return {
    centre: [round(middle((r) => r.centre_px[0])), round(middle((r) => r.centre_px[1]))],
    radius: round(middle((r) => r.radius_px)),
  };
}

const word = (text: string): string =>
  /^[\w.,:/=+-]+$/.test(text) ? text : `'${text.replaceAll("'", `'\\''`)}'`;
const file = (name: string): string => (name.startsWith("-") ? `./${name}` : name);

/** Return the command-line words of a setting without an option of its own. */
const setting = (key: string, value: string | number | boolean): string[] => [
  "--set",
  `${key}=${value}`,
];

/** Return the command-line options of a target. */
function boardOptions(board: BoardSpec): string[] {
  const { kind, columns, rows, square_mm, marker_mm, spacing, family, legacy } = board;
  return [
    "--board",
    `${columns}x${rows}`,
    "--square-mm",
    String(square_mm),
    ...(kind === "chessboard" ? [] : ["--target", kind]),
    ...(marker_mm ? setting("board.marker_mm", marker_mm) : []),
    ...(kind === "aprilgrid" && spacing !== 0.3 ? setting("board.spacing", spacing) : []),
    ...(family ? setting("board.family", family) : []),
    ...(legacy ? setting("board.legacy", true) : []),
  ];
}

/** Return the command that writes the target. */
export const printCommand = (board: BoardSpec): string =>
  ["omnimirror", "board", ...boardOptions(board), "-o", "board.pdf"].map(word).join(" ");

/** Return the equivalent calibration command. */
export function calibrateCommand(
  names: readonly string[],
  ask: Omit<CalibrationRequest, "command" | "images">,
): string {
  const images = names.length > MAX_NAMED || !names.length ? ["boards"] : names.map(file);
  return [
    "omnimirror",
    "calibrate",
    ...images,
    ...boardOptions(ask.board),
    ...(ask.model === "auto" ? [] : ["--model", ask.model]),
    ...(ask.optics === "mirror" ? [] : setting("camera.optics", ask.optics)),
    ...(ask.camera_looks === "up" ? [] : ["--camera-looks", ask.camera_looks]),
    ...(ask.image_flipped ? setting("camera.image_flipped", true) : []),
    ...(ask.centre_px ? setting("camera.centre_px", ask.centre_px.join(",")) : []),
    ...(ask.rim_radius_px ? setting("camera.rim_radius_px", ask.rim_radius_px) : []),
    ...(ask.flat_board ? setting("estimation.board_shape", false) : []),
    "-o",
    "camera.toml",
    "--report",
    "calibration.html",
  ]
    .map(word)
    .join(" ");
}

/** Format a number of pixels with its unit. */
export const px = (value: number | null, digits = 3): string =>
  value === null ? "–" : `${words(value, digits)} px`;
