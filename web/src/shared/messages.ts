// Made by web/message_types.py from the server's messages; not to be edited.

/** Data of a page without a server for arbitrary images. */
export interface Alone {
  version: string;
  cameras: CameraAlone[];
}

/** Evaluation of a design; followed by float32 values block by block, non-finite if undefined. */
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

/** Evaluation request for a design. */
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

/** Bench data of a page without a server. */
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

/** Sensor on the bench. */
export interface BenchSensor {
  tables: Record<string, any>;
  /** whether the lens stands where the mirror's mapping needs it */
  follows: boolean;
}

/** Initial data of the bench. */
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

/** Manual deformation of a design curve through a point. */
export interface Bend {
  of: "profile" | "mapping";
  /** where it is held: distance from the axis, mm, or field angle, deg */
  at: number;
  /** where it is pulled: height of the profile, mm, or image height, px */
  to: number;
}

/** Block of float32 values: named columns of equal length, stored column by column. */
export interface Block {
  name: string;
  columns: string[];
  rows: number;
}

/** Calibration board with the parameters of :class:`omnimirror.Board`. */
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

/** Board detection request for one image. */
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

/** Pose of a board, used for its dewarped image. */
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

/** Board detection in an image, or the reason for its failure. */
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

/** Effect of errors; followed by float32 values: x, y px of objects, and residuals dx, dy px for
each calibration. */
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

/** Sensor with errors. */
export interface BuiltAsk {
  tables: Record<string, any>;
  values: Record<string, any>;
  refocus: "none" | "rms" | "worst";
}

/** Initial data of the tab. */
export interface CalibrateStart {
  /** kinds that can be estimated, simple ones first */
  models: string[];
  /** those that no fisheye is */
  mirrors_only: string[];
  /** of markers */
  families: string[];
}

/** Calibration request; followed by one message per image with its detection. */
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

/** Result of a camera calibration. */
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

/** Progress of a calibration: status, estimated camera, report, or error. */
export interface CalibrationNews {
  state: "running" | "done" | "reported" | "failed";
  sentence: string;
  share: number | null;
  found: CalibrationFound | null;
  report: string | null;
}

/** Camera of a page without a server, for any mount. */
export interface CameraAlone {
  entry: SensorEntry;
  /** plumb, with the top of the picture forward: each way to look, reversed left to right and not */
  standing: CameraShown[];
  /** float32 values, little-endian, in base64 */
  tables: string;
  /** the picture that it takes of a room, in its address; none if empty */
  room: string;
}

/** Camera request with an optional mount; missing values are those of the camera file. */
export interface CameraAsk {
  id: string;
  camera_looks: "up" | "down" | "forward" | null;
  forward_azimuth_deg: number | null;
  image_flipped: boolean | null;
  pitch_deg: number | null;
  roll_deg: number | null;
}

/** Description of a camera for interactive views. */
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
  is_image_reversed: boolean;
  /** whether its circle may be moved to fit a picture */
  is_adjustable: boolean;
  tables: TableLayout;
}

/** Change of the kind of mirror or lens, or refocus by a merit. */
export interface Change {
  tables: Record<string, any>;
  what: "mirror" | "lens" | "focus";
  to: string;
  /** null: infinite */
  object_distance_mm: number | null;
}

/** Distribution of corners over the image: rings of equal area, sectors from the right clockwise
(via the bottom). */
export interface CoverageShown {
  centre_px: [number, number];
  radii_px: number[];
  counts: number[][];
  /** corners that a cell should have */
  enough: number;
}

/** Download request for a file of a design. */
export interface Download {
  tables: Record<string, any>;
  kind: "sensor" | "table" | "sag" | "drawing" | "report";
  object_distance_mm: number | null;
}

/** Data embedded in a page without a server. */
export interface Embedded {
  camera: CameraShown;
  /** float32 values, little-endian, in base64 */
  tables: string;
  /** address of the picture or video: with it inside, or of a file beside the page */
  media: string;
  is_video: boolean;
  name: string;
}

/** Effect of a single error at its tolerance: largest motion in px for each calibration, and the
limited merit. */
export interface ErrorAlone {
  name: string;
  tolerance: number;
  motion_px: (number | null)[];
  merit: number | null;
}

/** Error source of a sensor with its typical manufacturing tolerance. */
export interface ErrorOf {
  name: string;
  unit: string;
  meaning: string;
  group: string;
  coarse: number;
  medium: number;
  fine: number;
}

/** Request for the error sources of a sensor. */
export interface ErrorsAsk {
  tables: Record<string, any>;
}

/** Error sources of a sensor and names of the calibration models. */
export interface ErrorsOf {
  errors: ErrorOf[];
  calibrations: string[];
  /** whether sensors are traced by the thousand */
  is_quick: boolean;
}

/** Scalar properties of a design. */
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

/** Progress of a file export. */
export interface FileUnderWay {
  sentence: string;
  /** how much is done */
  share: number;
}

/** Status of the server. */
export interface Health {
  status: "ok";
  version: string;
}

/** Requirement with its achieved value. */
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

/** Levelling request; the image follows, and the image circle may be fitted to it. */
export interface LevelAsk {
  id: string;
  mount: MountOf;
  image_size: [number, number];
  centre_px: [number, number];
  rim_radius_px: number;
  name: string;
}

/** Tilt of the camera of an image, estimated from vertical edges. */
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

/** Camera model of the model comparison. */
export interface ModelTried {
  kind: string;
  parameters: number;
  rms_px: number;
  held_out_rms_px: number | null;
  why: string;
}

/** Mount of a camera. */
export interface MountOf {
  camera_looks: "up" | "down" | "forward";
  forward_azimuth_deg: number;
  image_flipped: boolean;
  pitch_deg: number;
  roll_deg: number;
}

/** Progress of a task. */
export interface News {
  state: "running" | "done" | "failed";
  sentence: string;
  /** how much is done */
  share: number | null;
  /** the merit by now */
  value: number | null;
  sensor: BenchSensor | null;
}

/** Imported file: a sensor or requirements. */
export interface Opened {
  sensor: BenchSensor | null;
  requirements: Record<string, any> | null;
}

/** Outlier corner. */
export interface OutlierFound {
  picture: string;
  corner: number;
  residual_px: number;
}

/** Estimated parameter of the camera or the board. */
export interface ParameterFound {
  name: string;
  value: number;
  /** null: it was fixed */
  sigma: number | null;
  unit: string;
}

/** Metadata of a parameter for its slider, number field and tooltip. */
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

/** Selectable part with its parameters in order. */
export interface PartOf {
  kind: string;
  parameters: ParameterOf[];
}

/** Request for a rendered image of the room and its panorama. */
export interface PictureAsk {
  tables: Record<string, any>;
  width_px: number;
  samples: number;
}

/** Calibration result of one image. */
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

/** Error response with the reason. */
export interface Problem {
  detail: string;
}

/** Quantity of the vocabulary of plots, requirements and optimiser. */
export interface QuantityOf {
  name: string;
  symbol: string;
  unit: string;
  title: string;
  meaning: string;
  equation: string;
}

/** Export request for a requirement file of a sensor. */
export interface RequirementFile {
  requirements: Record<string, any>;
  tables: Record<string, any>;
}

/** Restoration request; the image follows, and the image circle of the sensor may be fitted to
it. */
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

/** Detected mirror outline in an image. */
export interface RimFound {
  centre_px: [number, number];
  radius_px: number;
  confidence: number;
  is_sure: boolean;
}

/** Selectable camera. */
export interface SensorEntry {
  id: string;
  name: string;
  /** what it is, in a line */
  title: string;
  kind: "sensor" | "ocam" | "ball";
  mount: MountOf;
}

/** Sensor file request: a known sensor with its image circle fitted to an image. */
export interface SensorFile {
  id: string;
  mount: MountOf;
  image_size: [number, number];
  centre_px: [number, number];
  rim_radius_px: number;
}

/** Number of a design with its candidate values. */
export interface Slide {
  /** table, entry, and which of a list */
  path: string[];
  values: number[];
}

/** Request for the feasible ranges of sliders. */
export interface SlidesAsk {
  tables: Record<string, any>;
  follows: boolean;
  requirements: Record<string, any>;
  slides: Slide[];
}

/** Relative violation of each requirement, negative if satisfied; null for an invalid design. */
export interface SlidesOf {
  /** of each slide at each value */
  missed: ((number[] | null)[])[];
}

/** Image, video, camera or stream on the server. */
export interface Source {
  id: string;
  name: string;
  kind: "picture" | "video" | "live";
  /** how the command line names it, from where the server was started */
  command: string;
}

/** Initial data of the page. */
export interface Start {
  version: string;
  sources: Source[];
  sensors: SensorEntry[];
  /** the source to open first */
  source: string | null;
  /** the camera to begin with */
  sensor: string | null;
}

/** Dewarp request for an image of a board; the image follows. */
export interface StraightAsk {
  camera_file: string;
  place: BoardPlace;
  name: string;
}

/** State of a stream; frames are sent separately as binary messages. */
export interface StreamState {
  state: "waiting" | "playing" | "lost" | "ended";
  sentence: string;
}

/** Layout of the float32 values of camera tables, in this order; absent tables have count 0. */
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

/** Header of two JPEG files: image and panorama. */
export interface Taken {
  picture_bytes: number;
  panorama_bytes: number;
}

/** Long-running task: mirror optimisation or design from requirements. */
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

/** Joint analysis of images of one camera. */
export interface Together {
  /** why each of them is not used */
  reasons: (string | null)[];
  coverage: CoverageShown | null;
  advice: string[];
  /** why the candidate adds nothing; null where it does */
  not_new: string | null;
}

/** Analysis request for several images of one camera. */
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

/** Error source with its tolerance. */
export interface ToleranceOf {
  name: string;
  tolerance: number;
}

/** Error message with the entry that it concerns, if any. */
export interface Trouble {
  path: string[];
  sentence: string;
}

/** Request for a yield prediction. */
export interface YieldAsk {
  tables: Record<string, any>;
  errors: ToleranceOf[];
  refocus: "none" | "rms" | "worst";
  merit: string;
  limit: number;
  trials: number;
  seed: number;
}

/** Predicted yield with its 0.95 confidence interval. */
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
