/** What the bench needs of the page around it. */
export interface Host {
  place: HTMLElement;
  header: HTMLElement;
  isShown: () => boolean;
  address: () => string;
  setAddress: (design: string) => void;
  /** The errors that are tried, as the address has them. */
  errors: () => string;
  setErrors: (errors: string) => void;
  beforeLeaving: (act: () => void) => void;
  banner: (sentence: string | null, about: "server" | "address" | "bench") => void;
  say: (sentence: string) => void;
  /** Look through a sensor: its file, and its name. */
  lookThrough: (file: Blob, name: string) => Promise<void>;
}
