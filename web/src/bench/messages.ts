// Made by web/message_types.py from omnimirror.studio.bench.messages; not to be edited.

/** What a design does; float32 values follow, block by block, not finite where there is nothing. */
export interface Answer {
  slot: number;
  number: number;
  trouble: Trouble | null;
  /** what of the sensor the plots do not show */
  remark: string | null;
  facts: Facts | null;
  rows: Judged[];
  wanted_trouble: string | null;
  blocks: Block[];
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
  wanted: Record<string, any> | null;
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
  quantities: QuantityOf[];
  merits: QuantityOf[];
  families: string[];
  sensors: string[];
}

/** Part of the float32 values: so many rows of named columns, column by column. */
export interface Block {
  name: string;
  columns: string[];
  rows: number;
}

/** A change that takes more than a number: another kind of mirror or lens, or the best focus by a merit. */
export interface Change {
  tables: Record<string, any>;
  what: "mirror" | "lens" | "focus";
  to: string;
  /** null: infinite */
  object_distance_mm: number | null;
}

/** A file of a design. */
export interface Download {
  tables: Record<string, any>;
  kind: "sensor" | "table" | "sag" | "drawing" | "report";
  object_distance_mm: number | null;
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
  worst_area_deg2: number | null;
  resolution_px_per_deg: [number, number | null];
  /** why its mirror cannot be optimised, if it cannot */
  not_optimised: string | null;
}

/** A requirement, and what is reached of it. */
export interface Judged {
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
  wanted: Record<string, any> | null;
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

/** A quantity that a requirement or the optimiser can name. */
export interface QuantityOf {
  name: string;
  unit: string;
  meaning: string;
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
  wanted: Record<string, any> | null;
  /** null: infinite */
  object_distance_mm: number | null;
  merit: string;
  family: string;
  terms: number;
  starts: number;
}

/** Why something cannot be: the entry it is about, if it is about one, and a sentence. */
export interface Trouble {
  path: string[];
  sentence: string;
}

/** A requirement file to be written, and the sensor that it is for. */
export interface WantedFile {
  wanted: Record<string, any>;
  tables: Record<string, any>;
}
