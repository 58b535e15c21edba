// Made by web/message_types.py from the server's messages; not to be edited.

/** Error message with the entry that it concerns, if any. */
export interface ApiError {
  path: string[];
  sentence: string;
}

/** Sensor with errors. */
export interface AsBuiltRequest {
  tables: Record<string, any>;
  values: Record<string, any>;
  refocus: "none" | "rms" | "worst";
}

/** Effect of errors; followed by float32 values: x, y px of objects, and residuals dx, dy px for
each calibration. */
export interface AsBuiltResult {
  objects: number;
  /** number of objects that are not imaged */
  lost: number;
  /** image radius without errors */
  radius_px: number;
  /** maximum displacement after each calibration */
  motion_px: (number | null)[];
  direction_error_deg: (number | null)[];
  straightness_deg: (number | null)[];
  /** nominal and as-built value */
  blur_px: [number | null, number | null];
  /** nominal and as-built value */
  focus_mm: [number | null, number | null];
  /** sensor with errors; null if it is invalid */
  tables: Record<string, any> | null;
}

/** Sensor on the bench. */
export interface BenchSensor {
  tables: Record<string, any>;
  /** whether the lens position follows the mapping of the mirror */
  follows: boolean;
}

/** Initial data of the bench. */
export interface BenchStart {
  mirrors: PartInfo[];
  secondaries: PartInfo[];
  lenses: PartInfo[];
  imager: PartInfo;
  /** position of a second mirror */
  place: PartInfo;
  /** mirror distance */
  mount: PartInfo;
  /** misalignment of the mirror */
  pose: PartInfo;
  /** quantities that can be plotted over the field angle */
  columns: QuantityInfo[];
  /** quantities that requirements can limit */
  quantities: QuantityInfo[];
  /** quantities whose limits specify a spatial frequency */
  of_frequency: string[];
  merits: QuantityInfo[];
  /** freeform parametrisations for mirror optimisation */
  shapes: string[];
  sensors: string[];
}

/** Block of float32 values: named columns of equal length, stored column by column. */
export interface Block {
  name: string;
  columns: string[];
  rows: number;
}

/** Board detection in an image, or the reason for its failure. */
export interface BoardDetection {
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
  /** time of a video frame */
  time_s: number | null;
}

/** Board detection request for one image. */
export interface BoardDetectionRequest {
  kind: "chessboard" | "charuco" | "aprilgrid";
  columns: number;
  rows: number;
  square_mm: number;
  marker_mm: number | null;
  spacing: number;
  family: string | null;
  legacy: boolean;
  name: string;
  /** fast detection for live cameras */
  quick: boolean;
}

/** Pose of a board, used for its dewarped image. */
export interface BoardPose {
  picture: string;
  /** rotation from the board frame to the world frame */
  rotation: number[];
  shift_mm: [number, number, number];
  /** first corner of the board */
  low_mm: [number, number];
  high_mm: [number, number];
  /** margin around the corners */
  margin_mm: number;
  /** resolution of the image at the board */
  px_per_mm: number;
  /** whether the y axis of the board points up */
  is_upwards: boolean;
}

/** Calibration board with the parameters of :class:`omnimirror.Board`. */
export interface BoardSpec {
  kind: "chessboard" | "charuco" | "aprilgrid";
  columns: number;
  rows: number;
  square_mm: number;
  marker_mm: number | null;
  spacing: number;
  family: string | null;
  legacy: boolean;
}

/** Dewarp request for an image of a board; the image follows. */
export interface BoardViewRequest {
  camera_file: string;
  place: BoardPose;
  name: string;
}

/** Initial data of the tab. */
export interface CalibrationOptions {
  /** camera models, in increasing complexity */
  models: string[];
  /** models for mirrors only */
  mirrors_only: string[];
  /** marker families */
  families: string[];
}

/** Calibration request; followed by one message per image with its detection. */
export interface CalibrationRequest {
  board: BoardSpec;
  pictures: number;
  model: string;
  optics: "mirror" | "fisheye";
  camera_looks: "up" | "down" | "forward";
  image_flipped: boolean;
  centre_px: [number, number] | null;
  rim_radius_px: number | null;
  flat_board: boolean;
  /** equivalent command line for the report */
  command: string;
}

/** Result of a camera calibration. */
export interface CalibrationResult {
  kind: string;
  summary: string;
  rms_px: number;
  held_out_rms_px: number | null;
  corners: number;
  seconds: number;
  is_complete: boolean;
  image_size: [number, number];
  pictures: ImageResult[];
  parameters: ParameterEstimate[];
  models: ModelComparisonRow[];
  outliers: OutlierCorner[];
  notes: string[];
  advice: string[];
  coverage: CoverageInfo;
  places: BoardPose[];
  camera_file: string;
}

/** Progress of a calibration: status, estimated camera, report, or error. */
export interface CalibrationStatus {
  state: "running" | "done" | "reported" | "failed";
  sentence: string;
  share: number | null;
  found: CalibrationResult | null;
  report: string | null;
}

/** Description of a camera for interactive views. */
export interface CameraInfo {
  id: string;
  name: string;
  title: string;
  kind: "sensor" | "ocam" | "ball";
  /** command-line options of the camera */
  options: string[];
  mount: MountInfo;
  mount_in_file: MountInfo;
  image_size: [number, number];
  /** image of the axis */
  centre_px: [number, number];
  /** image radius of the field boundary, or its mean if it is not circular */
  rim_radius_px: number;
  axis: [number, number, number];
  right: [number, number, number];
  down: [number, number, number];
  tilt_min_deg: number;
  tilt_max_deg: number;
  pixels_per_degree: number;
  pole: "nadir" | "zenith";
  is_picture_reversed: boolean;
  /** whether its circle can be fitted to an image */
  is_adjustable: boolean;
  tables: TableLayout;
}

/** Camera request with an optional mount; missing values are those of the camera file. */
export interface CameraRequest {
  id: string;
  camera_looks: "up" | "down" | "forward" | null;
  forward_azimuth_deg: number | null;
  image_flipped: boolean | null;
  pitch_deg: number | null;
  roll_deg: number | null;
}

/** Distribution of corners over the image: rings of equal area, sectors from the right clockwise
(via the bottom). */
export interface CoverageInfo {
  centre_px: [number, number];
  radii_px: number[];
  counts: number[][];
  /** recommended minimum number of corners per cell */
  enough: number;
}

/** Manual deformation of a design curve through a point. */
export interface CurveEdit {
  of: "profile" | "mapping";
  /** position of the handle: distance from the axis, mm, or field angle, deg */
  at: number;
  /** new value at the handle: height of the profile, mm, or image height, px */
  to: number;
}

/** Change of the kind of mirror or lens, or refocus by a merit. */
export interface DesignChange {
  tables: Record<string, any>;
  what: "mirror" | "lens" | "focus";
  to: string;
  /** null: infinite */
  object_distance_mm: number | null;
}

/** Evaluation request for a design. */
export interface DesignRequest {
  /** index of the displayed design */
  slot: number;
  number: number;
  tables: Record<string, any>;
  follows: boolean;
  /** null: infinite */
  object_distance_mm: number | null;
  section: boolean;
  squares: boolean;
  /** whether to return parts and rays for the 3-D view */
  space: boolean;
  requirements: Record<string, any> | null;
  /** manual deformation applied before the evaluation */
  bend: CurveEdit | null;
}

/** Evaluation of a design; followed by float32 values block by block, non-finite if undefined. */
export interface DesignResponse {
  slot: number;
  number: number;
  trouble: ApiError | null;
  /** properties of the sensor that the plots do not include */
  remark: string | null;
  facts: DesignSummary | null;
  rows: RequirementResult[];
  requirements_trouble: string | null;
  blocks: Block[];
  /** deformed design */
  bent: BenchSensor | null;
}

/** Scalar properties of a design. */
export interface DesignSummary {
  name: string;
  field_deg: [number, number];
  rim_radius_mm: number;
  rim_radius_px: number;
  /** radius of the largest circle inscribed in the imager */
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
  /** reason for which the mirror cannot be optimised; null if it can */
  not_optimised: string | null;
}

/** Detected mirror outline in an image. */
export interface DetectedOutline {
  centre_px: [number, number];
  radius_px: number;
  confidence: number;
  is_sure: boolean;
}

/** Data embedded in a page without a server. */
export interface EmbeddedImage {
  camera: CameraInfo;
  /** float32 values, little-endian, in base64 */
  tables: string;
  /** URL of the image or video: a data URL, or a file next to the page */
  media: string;
  is_video: boolean;
  name: string;
}

/** Error source of a sensor with its typical manufacturing tolerance. */
export interface ErrorSourceInfo {
  name: string;
  unit: string;
  meaning: string;
  group: string;
  coarse: number;
  medium: number;
  fine: number;
}

/** Error sources of a sensor and names of the calibration models. */
export interface ErrorSourceList {
  errors: ErrorSourceInfo[];
  calibrations: string[];
  /** whether ray tracing is vectorised over sensors */
  is_quick: boolean;
}

/** Request for the error sources of a sensor. */
export interface ErrorSourcesRequest {
  tables: Record<string, any>;
}

/** Tilt of the camera of an image, estimated from vertical edges. */
export interface EstimatedTilt {
  pitch_deg: number;
  roll_deg: number;
  /** standard error of the vertical direction */
  sigma_deg: number;
  /** number of vertical edges */
  upright: number;
  /** whether it is reliable enough for automatic use */
  is_sure: boolean;
}

/** Progress of a file export. */
export interface FileProgress {
  sentence: string;
  /** completed fraction */
  share: number;
}

/** Download request for a file of a design. */
export interface FileRequest {
  tables: Record<string, any>;
  kind: "sensor" | "table" | "sag" | "drawing" | "report";
  object_distance_mm: number | null;
}

/** Status of the server. */
export interface Health {
  status: "ok";
  version: string;
}

/** Calibration result of one image. */
export interface ImageResult {
  name: string;
  found: number;
  used: boolean;
  reason: string | null;
  rms_px: number | null;
  /** RMS in a fit without this image (cross-validation) */
  held_out_rms_px: number | null;
  /** maximum deviation of corners from straight lines on the undistorted board */
  line_deviation_px: number | null;
  /** corner u, v and residual du, dv, px */
  residuals: [number, number, number, number][];
}

/** Imported file: a sensor or requirements. */
export interface ImportedFile {
  sensor: BenchSensor | null;
  requirements: Record<string, any> | null;
}

/** Levelling request; the image follows, and the image circle may be fitted to it. */
export interface LevelRequest {
  id: string;
  mount: MountInfo;
  image_size: [number, number];
  centre_px: [number, number];
  rim_radius_px: number;
  name: string;
}

/** Camera model of the model comparison. */
export interface ModelComparisonRow {
  kind: string;
  parameters: number;
  rms_px: number;
  held_out_rms_px: number | null;
  why: string;
}

/** Mount of a camera. */
export interface MountInfo {
  camera_looks: "up" | "down" | "forward";
  forward_azimuth_deg: number;
  image_flipped: boolean;
  pitch_deg: number;
  roll_deg: number;
}

/** Analysis request for several images of one camera. */
export interface MultiImageRequest {
  board: BoardSpec;
  pictures: BoardDetection[];
  /** centre of the field; null: image centre */
  centre_px: [number, number] | null;
  /** radius of the field; null: distance of the farthest corner */
  radius_px: number | null;
  /** detection in the current frame of a live camera */
  candidate: BoardDetection | null;
}

/** Joint analysis of images of one camera. */
export interface MultiImageSummary {
  /** reason for the rejection of each image; null if used */
  reasons: (string | null)[];
  coverage: CoverageInfo | null;
  advice: string[];
  /** reason against the candidate; null if it adds information */
  not_new: string | null;
}

/** Outlier corner. */
export interface OutlierCorner {
  picture: string;
  corner: number;
  residual_px: number;
}

/** Initial data of the page. */
export interface PageStart {
  version: string;
  sources: Source[];
  sensors: SensorEntry[];
  /** initial source */
  source: string | null;
  /** initial camera */
  sensor: string | null;
}

/** Estimated parameter of the camera or the board. */
export interface ParameterEstimate {
  name: string;
  value: number;
  /** standard deviation; null for fixed parameters */
  sigma: number | null;
  unit: string;
}

/** Metadata of a parameter for its slider, number field and tooltip. */
export interface ParameterInfo {
  name: string;
  unit: string;
  low: number;
  high: number;
  description: string;
  choices: string[];
  is_list: boolean;
  is_whole: boolean;
  is_optional: boolean;
  /** default of an optional number; null if it has none */
  default: number | null;
}

/** Selectable part with its parameters in order. */
export interface PartInfo {
  kind: string;
  parameters: ParameterInfo[];
}

/** Error response with the reason. */
export interface Problem {
  detail: string;
}

/** Quantity of the vocabulary of plots, requirements and optimiser. */
export interface QuantityInfo {
  name: string;
  symbol: string;
  unit: string;
  title: string;
  meaning: string;
  equation: string;
}

/** Header of two JPEG files: image and panorama. */
export interface RenderHeader {
  picture_bytes: number;
  panorama_bytes: number;
}

/** Request for a rendered image of the room and its panorama. */
export interface RenderRequest {
  tables: Record<string, any>;
  width_px: number;
  samples: number;
}

/** Export request for a requirement file of a sensor. */
export interface RequirementFileRequest {
  requirements: Record<string, any>;
  tables: Record<string, any>;
}

/** Requirement with its achieved value. */
export interface RequirementResult {
  name: string;
  unit: string;
  at_least: number | null;
  at_most: number | null;
  reached: number | null;
  margin: number | null;
  is_met: boolean;
  /** field angle of the critical value */
  omega_deg: number | null;
  part_deg: [number, number] | null;
  /** index of the limit */
  limit: number | null;
}

/** Restoration request; the image follows, and the image circle of the sensor may be fitted to
it. */
export interface RestoreRequest {
  id: string;
  mount: MountInfo;
  image_size: [number, number];
  centre_px: [number, number];
  rim_radius_px: number;
  name: string;
  /** object distance; null: infinite */
  object_distance_mm: number | null;
}

/** Long-running task: mirror optimisation or design from requirements. */
export interface SearchTask {
  what: "optimise" | "design";
  tables: Record<string, any>;
  requirements: Record<string, any> | null;
  /** null: infinite */
  object_distance_mm: number | null;
  merit: string;
  /** freeform parametrisation of the mirror */
  shape: string;
  /** whether the optimised mirror must meet the limits of the requirements */
  keeps_limits: boolean;
  terms: number;
  starts: number;
}

/** Selectable camera. */
export interface SensorEntry {
  id: string;
  name: string;
  /** one-line description */
  title: string;
  kind: "sensor" | "ocam" | "ball";
  mount: MountInfo;
}

/** Sensor file request: a known sensor with its image circle fitted to an image. */
export interface SensorFileRequest {
  id: string;
  mount: MountInfo;
  image_size: [number, number];
  centre_px: [number, number];
  rim_radius_px: number;
}

/** Effect of a single error at its tolerance: largest motion in px for each calibration, and the
limited merit. */
export interface SingleErrorEffect {
  name: string;
  tolerance: number;
  motion_px: (number | null)[];
  merit: number | null;
}

/** Request for the feasible ranges of sliders. */
export interface SliderRequest {
  tables: Record<string, any>;
  follows: boolean;
  requirements: Record<string, any>;
  slides: SliderValues[];
}

/** Number of a design with its candidate values. */
export interface SliderValues {
  /** table, entry, and index in a list */
  path: string[];
  values: number[];
}

/** Relative violation of each requirement, negative if satisfied; null for an invalid design. */
export interface SliderViolations {
  /** violations by slider and value */
  missed: ((number[] | null)[])[];
}

/** Image, video, camera or stream on the server. */
export interface Source {
  id: string;
  name: string;
  kind: "picture" | "video" | "live";
  /** path for the command line, relative to the working directory of the server */
  command: string;
}

/** Bench data of a page without a server. */
export interface StandaloneBench {
  start: BenchStart;
  /** sensors in the order of their names in start */
  sensors: BenchSensor[];
  /** parameters of the focus search of the compiled evaluator */
  search: number[];
  /** compiled evaluator, WebAssembly in base64 */
  kernel: string;
  /** script of the bench */
  script: string;
}

/** Camera of a page without a server, for any mount. */
export interface StandaloneCamera {
  entry: SensorEntry;
  /** models without tilt, with the image top forward: each orientation, flipped and not flipped */
  standing: CameraInfo[];
  /** float32 values, little-endian, in base64 */
  tables: string;
  /** rendered image of a room as a data URL; empty if there is none */
  room: string;
}

/** Data of a page without a server for arbitrary images. */
export interface StandalonePage {
  version: string;
  cameras: StandaloneCamera[];
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
  /** sin(Omega/2) of the last radius, or of the lattice boundary */
  last: number;
  /** approximate viewpoint for near objects along the axis */
  eye_mm: number;
  /** number of image radii, px, at equidistant sin(Omega/2) */
  radii: number;
  /** number of ray origins, mm: distances from the axis, then positions along it */
  origins: number;
  /** side length of the lattice of pixels (u, v) over sin(Omega/2) (cos, sin) of the azimuth */
  lattice: number;
  /** number of boundary values sin(Omega/2) at equidistant azimuths */
  limits: number;
  /** side length of the lattice of ray origins over the same disk: mm along axis, right, down */
  starts: number;
}

/** Progress of a task. */
export interface TaskStatus {
  state: "running" | "done" | "failed";
  sentence: string;
  /** completed fraction */
  share: number | null;
  /** current merit */
  value: number | null;
  sensor: BenchSensor | null;
}

/** Error source with its tolerance. */
export interface ToleranceValue {
  name: string;
  tolerance: number;
}

/** Request for a yield prediction. */
export interface YieldRequest {
  tables: Record<string, any>;
  errors: ToleranceValue[];
  refocus: "none" | "rms" | "worst";
  merit: string;
  limit: number;
  trials: number;
  seed: number;
}

/** Predicted yield with its 0.95 confidence interval. */
export interface YieldResult {
  trials: number;
  lost: number;
  share: number;
  low: number;
  high: number;
  median: number | null;
  /** 95 % quantile */
  most: number | null;
  /** in descending order */
  rows: SingleErrorEffect[];
}
