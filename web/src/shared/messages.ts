// Made by web/message_types.py from the server's messages; not to be edited.

/** What a page for any picture holds that no server helps. */
export interface Alone {
  version: string;
  cameras: CameraAlone[];
}

/** What a design does; float32 values follow, block by block, not finite where there is nothing. */
export interface Answer {
  slot: number;
  number: number;
  trouble: Trouble | null;
  /** what of the sensor the plots do not show */
  remark: string | null;
  facts: Facts | null;
  rows: JudgementOf[];
  requirements_trouble: string | null;
  blocks: Block[];
  /** the design as it was bent */
  bent: BenchSensor | null;
}

/** What a page wants to know of a design. */
export interface Ask {
  /** which of the designs shown */
  slot: number;
  number: number;
  tables: Record<string, any>;
  follows: boolean;
  /** null: infinite */
  object_distance_mm: number | null;
  section: boolean;
  squares: boolean;
  /** its parts and rays in three dimensions */
  space: boolean;
  requirements: Record<string, any> | null;
  /** of which it is answered as it is bent by hand */
  bend: Bend | null;
}

/** What a page holds of the bench that no server helps. */
export interface BenchAlone {
  start: BenchStart;
  /** in the order of their names in start */
  sensors: BenchSensor[];
  /** how a best focus is looked for, as the compiled evaluator takes it */
  search: number[];
  /** the compiled evaluator, WebAssembly in base64 */
  kernel: string;
  /** of the bench */
  script: string;
}

/** A sensor on the bench. */
export interface BenchSensor {
  tables: Record<string, any>;
  /** whether the lens stands where the mirror's mapping needs it */
  follows: boolean;
}

/** What the bench is made from. */
export interface BenchStart {
  mirrors: PartOf[];
  secondaries: PartOf[];
  lenses: PartOf[];
  imager: PartOf;
  /** of a second mirror */
  place: PartOf;
  /** how far the mirror stands */
  mount: PartOf;
  /** how far the mirror is out of its place */
  pose: PartOf;
  /** what plots can show against the field angle */
  columns: QuantityOf[];
  /** what a requirement can limit */
  quantities: QuantityOf[];
  /** those of which a limit says at which spatial frequency */
  of_frequency: string[];
  merits: QuantityOf[];
  /** free forms in which a mirror can be sought */
  shapes: string[];
  sensors: string[];
}

/** A curve of the design that is pulled through a point by hand. */
export interface Bend {
  of: "profile" | "mapping";
  /** where it is held: distance from the axis, mm, or field angle, deg */
  at: number;
  /** where it is pulled: height of the profile, mm, or image height, px */
  to: number;
}

/** Part of the float32 values: so many rows of named columns, column by column. */
export interface Block {
  name: string;
  columns: string[];
  rows: number;
}

/** A calibration board, as :class:`omnimirror.Board` takes it. */
export interface BoardAsked {
  kind: "chessboard" | "charuco" | "aprilgrid";
  columns: number;
  rows: number;
  square_mm: number;
  marker_mm: number | null;
  spacing: number;
  family: string | null;
  legacy: boolean;
}

/** A question about one picture: where in it the board is. */
export interface BoardLook {
  kind: "chessboard" | "charuco" | "aprilgrid";
  columns: number;
  rows: number;
  square_mm: number;
  marker_mm: number | null;
  spacing: number;
  family: string | null;
  legacy: boolean;
  name: string;
  /** as for pictures of a camera that runs */
  quick: boolean;
}

/** Where a board stood: what a straightened picture of it is made from. */
export interface BoardPlace {
  picture: string;
  /** from the board's frame to the world's */
  rotation: number[];
  shift_mm: [number, number, number];
  /** the board's first corner */
  low_mm: [number, number];
  high_mm: [number, number];
  /** how much is shown about the corners */
  margin_mm: number;
  /** as fine as the picture is there */
  px_per_mm: number;
  /** whether the board's Y points up */
  is_upwards: boolean;
}

/** What was found of a board in a picture, or why nothing was. */
export interface BoardSeen {
  name: string;
  image_size: [number, number];
  ids: number[];
  corners_px: [number, number][];
  sigma_px: number[] | null;
  reason: string | null;
  blur_px: number | null;
  is_reversed: boolean | null;
  begins_white: boolean | null;
  is_part: boolean;
  /** of a frame of a video */
  time_s: number | null;
}

/** What errors do; float32 values follow: x, y px of objects, and by calibrations dx, dy px of what is left. */
export interface Built {
  objects: number;
  /** objects that are not shown */
  lost: number;
  /** of the picture without errors */
  radius_px: number;
  /** the largest, by calibrations */
  motion_px: (number | null)[];
  direction_error_deg: (number | null)[];
  straightness_deg: (number | null)[];
  /** meant and built */
  blur_px: [number | null, number | null];
  /** meant and built */
  focus_mm: [number | null, number | null];
  /** the sensor with its errors, if there can be one */
  tables: Record<string, any> | null;
}

/** A sensor with errors. */
export interface BuiltAsk {
  tables: Record<string, any>;
  values: Record<string, any>;
  refocus: "none" | "rms" | "worst";
}

/** What the tab is made from. */
export interface CalibrateStart {
  /** kinds that can be estimated, simple ones first */
  models: string[];
  /** those that no fisheye is */
  mirrors_only: string[];
  /** of markers */
  families: string[];
}

/** A calibration to be made; what was found in its pictures follows, a message each. */
export interface CalibrationAsk {
  board: BoardAsked;
  pictures: number;
  model: string;
  optics: "mirror" | "fisheye";
  camera_looks: "up" | "down" | "forward";
  image_flipped: boolean;
  centre_px: [number, number] | null;
  rim_radius_px: number | null;
  flat_board: boolean;
  /** that does the same, for the report */
  command: string;
}

/** A camera measured from its pictures. */
export interface CalibrationFound {
  kind: string;
  summary: string;
  rms_px: number;
  held_out_rms_px: number | null;
  corners: number;
  seconds: number;
  is_complete: boolean;
  image_size: [number, number];
  pictures: PictureOutcome[];
  parameters: ParameterFound[];
  models: ModelTried[];
  outliers: OutlierFound[];
  notes: string[];
  advice: string[];
  coverage: CoverageShown;
  places: BoardPlace[];
  camera_file: string;
}

/** How a calibration is doing: on its way, the camera it ended with and then its report, or why there is none. */
export interface CalibrationNews {
  state: "running" | "done" | "reported" | "failed";
  sentence: string;
  share: number | null;
  found: CalibrationFound | null;
  report: string | null;
}

/** A camera of a page that no server helps, however it stands. */
export interface CameraAlone {
  entry: SensorEntry;
  /** plumb, with the top of the picture forward: each way to look, reversed left to right and not */
  standing: CameraShown[];
  /** float32 values, little-endian, in base64 */
  tables: string;
  /** the picture that it takes of a room, in its address; none if empty */
  room: string;
}

/** Which camera, and how it stands; what is not said is as its file has it. */
export interface CameraAsk {
  id: string;
  camera_looks: "up" | "down" | "forward" | null;
  forward_azimuth_deg: number | null;
  image_flipped: boolean | null;
  pitch_deg: number | null;
  roll_deg: number | null;
}

/** A camera, as far as looking through it needs to know. */
export interface CameraShown {
  id: string;
  name: string;
  title: string;
  kind: "sensor" | "ocam" | "ball";
  /** what names it on the command line */
  options: string[];
  mount: MountOf;
  mount_in_file: MountOf;
  image_size: [number, number];
  /** image of the axis */
  centre_px: [number, number];
  /** image radius of the end of the field; its mean where it is no circle */
  rim_radius_px: number;
  axis: [number, number, number];
  right: [number, number, number];
  down: [number, number, number];
  tilt_min_deg: number;
  tilt_max_deg: number;
  pixels_per_degree: number;
  pole: "nadir" | "zenith";
  is_picture_reversed: boolean;
  /** whether its circle may be moved to fit a picture */
  is_adjustable: boolean;
  tables: TableLayout;
}

/** A change that takes more than a number: another kind of mirror or lens, or the best focus by a merit. */
export interface Change {
  tables: Record<string, any>;
  what: "mirror" | "lens" | "focus";
  to: string;
  /** null: infinite */
  object_distance_mm: number | null;
}

/** How corners are spread over the picture: rings of equal areas, sectors from the right over the bottom. */
export interface CoverageShown {
  centre_px: [number, number];
  radii_px: number[];
  counts: number[][];
  /** corners that a cell should have */
  enough: number;
}

/** A file of a design. */
export interface Download {
  tables: Record<string, any>;
  kind: "sensor" | "table" | "sag" | "drawing" | "report";
  object_distance_mm: number | null;
}

/** What a page that does without a server holds. */
export interface Embedded {
  camera: CameraShown;
  /** float32 values, little-endian, in base64 */
  tables: string;
  /** address of the picture or video: with it inside, or of a file beside the page */
  media: string;
  is_video: boolean;
  name: string;
}

/** What an error does alone at its tolerance: the largest motion in px by calibrations, and the limited merit. */
export interface ErrorAlone {
  name: string;
  tolerance: number;
  motion_px: (number | null)[];
  merit: number | null;
}

/** An error that a sensor can have, and how shops hold it. */
export interface ErrorOf {
  name: string;
  unit: string;
  meaning: string;
  group: string;
  coarse: number;
  medium: number;
  fine: number;
}

/** Which errors a sensor can have. */
export interface ErrorsAsk {
  tables: Record<string, any>;
}

/** The errors of a sensor, and what calibrations are called. */
export interface ErrorsOf {
  errors: ErrorOf[];
  calibrations: string[];
  /** whether sensors are traced by the thousand */
  is_quick: boolean;
}

/** What holds for the whole design. */
export interface Facts {
  name: string;
  field_deg: [number, number];
  rim_radius_mm: number;
  rim_radius_px: number;
  /** largest circle that the imager holds */
  imager_radius_px: number;
  mirror_distance_mm: number | null;
  focus_mm: number;
  depth_of_field_mm: [number, number | null];
  airy_px: number;
  length_mm: number;
  viewpoint_spread_mm: number;
  worst_blur_px: number | null;
  worst_floored_area_deg2: number | null;
  resolution_px_per_deg: [number, number | null];
  /** why its mirror cannot be optimised, if it cannot */
  not_optimised: string | null;
}

/** How far a file is that takes long. */
export interface FileUnderWay {
  sentence: string;
  /** how much is done */
  share: number;
}

/** That the server is there. */
export interface Health {
  status: "ok";
  version: string;
}

/** A requirement, and what is reached of it. */
export interface JudgementOf {
  name: string;
  unit: string;
  at_least: number | null;
  at_most: number | null;
  reached: number | null;
  margin: number | null;
  is_met: boolean;
  /** where the worst value is */
  omega_deg: number | null;
  part_deg: [number, number] | null;
  /** which of the limits it is */
  limit: number | null;
}

/** How the camera leaned is asked, of a picture that comes behind; its circle may have been moved to fit it. */
export interface LevelAsk {
  id: string;
  mount: MountOf;
  image_size: [number, number];
  centre_px: [number, number];
  rim_radius_px: number;
  name: string;
}

/** How the camera leaned that took a picture, by the edges that stand upright in it. */
export interface LevelFound {
  pitch_deg: number;
  roll_deg: number;
  /** standard error of the plumb line */
  sigma_deg: number;
  /** edges that stand upright */
  upright: number;
  /** it may be taken unasked */
  is_sure: boolean;
}

/** A model that was compared. */
export interface ModelTried {
  kind: string;
  parameters: number;
  rms_px: number;
  held_out_rms_px: number | null;
  why: string;
}

/** How a camera stands. */
export interface MountOf {
  camera_looks: "up" | "down" | "forward";
  forward_azimuth_deg: number;
  image_flipped: boolean;
  pitch_deg: number;
  roll_deg: number;
}

/** How a task is getting on. */
export interface News {
  state: "running" | "done" | "failed";
  sentence: string;
  /** how much is done */
  share: number | null;
  /** the merit by now */
  value: number | null;
  sensor: BenchSensor | null;
}

/** A file that was opened: a sensor, or requirements. */
export interface Opened {
  sensor: BenchSensor | null;
  requirements: Record<string, any> | null;
}

/** A corner that was left out. */
export interface OutlierFound {
  picture: string;
  corner: number;
  residual_px: number;
}

/** A parameter of the camera or of the board. */
export interface ParameterFound {
  name: string;
  value: number;
  /** null: it was fixed */
  sigma: number | null;
  unit: string;
}

/** A parameter as a part describes it: what a slider, a number field and a tooltip need. */
export interface ParameterOf {
  name: string;
  unit: string;
  low: number;
  high: number;
  description: string;
  choices: string[];
  is_list: boolean;
  is_whole: boolean;
  is_optional: boolean;
  /** of an optional number, where it is a number */
  default: number | null;
}

/** A part that can be chosen, and its parameters in their order. */
export interface PartOf {
  kind: string;
  parameters: ParameterOf[];
}

/** The picture that a design takes of the room, and its panorama. */
export interface PictureAsk {
  tables: Record<string, any>;
  width_px: number;
  samples: number;
}

/** What became of a picture. */
export interface PictureOutcome {
  name: string;
  found: number;
  used: boolean;
  reason: string | null;
  rms_px: number | null;
  /** in a fit that was made without it */
  held_out_rms_px: number | null;
  /** how far its corners lie off the lines of the straightened board */
  off_straight_px: number | null;
  /** corner u, v, and how far it lies off */
  residuals: [number, number, number, number][];
}

/** Why something was refused, in a sentence. */
export interface Problem {
  detail: string;
}

/** A quantity of the vocabulary: what plots, requirements and the optimiser call it. */
export interface QuantityOf {
  name: string;
  symbol: string;
  unit: string;
  title: string;
  meaning: string;
  equation: string;
}

/** A requirement file to be written, and the sensor that it is for. */
export interface RequirementFile {
  requirements: Record<string, any>;
  tables: Record<string, any>;
}

/** A picture to be restored, which comes behind: through a sensor whose circle may have been moved to fit it. */
export interface RestoreAsk {
  id: string;
  mount: MountOf;
  image_size: [number, number];
  centre_px: [number, number];
  rim_radius_px: number;
  name: string;
  /** of what is seen; none: far away */
  object_distance_mm: number | null;
}

/** The circle of a mirror, as it was found in a picture. */
export interface RimFound {
  centre_px: [number, number];
  radius_px: number;
  confidence: number;
  is_sure: boolean;
}

/** A camera that can be chosen. */
export interface SensorEntry {
  id: string;
  name: string;
  /** what it is, in a line */
  title: string;
  kind: "sensor" | "ocam" | "ball";
  mount: MountOf;
}

/** A sensor file to be made: a known sensor whose circle was moved to fit a picture. */
export interface SensorFile {
  id: string;
  mount: MountOf;
  image_size: [number, number];
  centre_px: [number, number];
  rim_radius_px: number;
}

/** A number of the design, and values that it could have. */
export interface Slide {
  /** table, entry, and which of a list */
  path: string[];
  values: number[];
}

/** Where the numbers of a design could stand, for its requirements to be met. */
export interface SlidesAsk {
  tables: Record<string, any>;
  follows: boolean;
  requirements: Record<string, any>;
  slides: Slide[];
}

/** By what share of what is asked each requirement is missed, below 0 kept; null where the design cannot be. */
export interface SlidesOf {
  /** of each slide at each value */
  missed: ((number[] | null)[])[];
}

/** A picture, video, camera or stream at the server's side. */
export interface Source {
  id: string;
  name: string;
  kind: "picture" | "video" | "live";
  /** how the command line names it, from where the server was started */
  command: string;
}

/** What the page opens with. */
export interface Start {
  version: string;
  sources: Source[];
  sensors: SensorEntry[];
  /** the source to open first */
  source: string | null;
  /** the camera to begin with */
  sensor: string | null;
}

/** A picture of a board to be straightened by a camera; the picture follows. */
export interface StraightAsk {
  camera_file: string;
  place: BoardPlace;
  name: string;
}

/** How a stream is doing; pictures come beside it, as binary messages. */
export interface StreamState {
  state: "waiting" | "playing" | "lost" | "ended";
  sentence: string;
}

/** What the float32 values of a camera's tables are, in this order; those that are absent count 0. */
export interface TableLayout {
  /** sin(Omega/2) of the first radius */
  first: number;
  /** sin(Omega/2) of the last radius, or where the lattice ends */
  last: number;
  /** about where along the axis near things are seen from */
  eye_mm: number;
  /** image radii, px, at even steps of sin(Omega/2) */
  radii: number;
  /** origins of rays, mm: so many from the axis, then so many along it */
  origins: number;
  /** side of a lattice of pixels (u, v) over sin(Omega/2) (cos, sin) of the azimuth */
  lattice: number;
  /** sin(Omega/2) where the field ends, at even steps of the azimuth */
  limits: number;
  /** side of a lattice, over the same disk, of where rays start: mm along axis, right, down */
  starts: number;
}

/** Two JPEG files that follow: the picture, and its panorama. */
export interface Taken {
  picture_bytes: number;
  panorama_bytes: number;
}

/** Something that takes time: to optimise a mirror, or to design a sensor from requirements. */
export interface Task {
  what: "optimise" | "design";
  tables: Record<string, any>;
  requirements: Record<string, any> | null;
  /** null: infinite */
  object_distance_mm: number | null;
  merit: string;
  /** the free form in which the mirror is sought */
  shape: string;
  /** whether an optimised mirror keeps the limits of the requirements */
  keeps_limits: boolean;
  terms: number;
  starts: number;
}

/** What pictures of one camera are together. */
export interface Together {
  /** why each of them is not used */
  reasons: (string | null)[];
  coverage: CoverageShown | null;
  advice: string[];
  /** why the candidate adds nothing; null where it does */
  not_new: string | null;
}

/** A question about pictures of one camera: what they are together. */
export interface TogetherAsk {
  board: BoardAsked;
  pictures: BoardSeen[];
  /** of the field; null: the middle of the picture */
  centre_px: [number, number] | null;
  /** of the field; null: that of the farthest corner */
  radius_px: number | null;
  /** what a camera sees now */
  candidate: BoardSeen | null;
}

/** An error and its tolerance. */
export interface ToleranceOf {
  name: string;
  tolerance: number;
}

/** Why something cannot be: the entry it is about, if it is about one, and a sentence. */
export interface Trouble {
  path: string[];
  sentence: string;
}

/** How many sensors will be good. */
export interface YieldAsk {
  tables: Record<string, any>;
  errors: ToleranceOf[];
  refocus: "none" | "rms" | "worst";
  merit: string;
  limit: number;
  trials: number;
  seed: number;
}

/** How many of the sensors built are good, with a confidence of .95. */
export interface YieldOf {
  trials: number;
  lost: number;
  share: number;
  low: number;
  high: number;
  median: number | null;
  /** within which 95 % stay */
  most: number | null;
  /** the worst first */
  rows: ErrorAlone[];
}
