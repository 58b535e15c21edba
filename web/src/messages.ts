// Made by web/message_types.py from omnimirror.studio.messages; not to be edited.

/** A camera, as far as looking through it needs to know. */
export interface CameraModel {
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

/** What a page that does without a server holds. */
export interface Embedded {
  camera: CameraModel;
  /** float32 values, little-endian, in base64 */
  tables: string;
  /** address of the picture or video: with it inside, or of a file beside the page */
  media: string;
  is_video: boolean;
  name: string;
}

/** That the server is there. */
export interface Health {
  status: "ok";
  version: string;
}

/** How a camera stands. */
export interface MountOf {
  camera_looks: "up" | "down" | "forward";
  forward_azimuth_deg: number;
  image_flipped: boolean;
  pitch_deg: number;
  roll_deg: number;
}

/** Why something was refused, in a sentence. */
export interface Problem {
  detail: string;
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
