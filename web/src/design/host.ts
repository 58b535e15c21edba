/** Interface of the page for the Design tab. */
export interface Host {
  place: HTMLElement;
  header: HTMLElement;
  isShown: () => boolean;
  address: () => string;
  setAddress: (design: string) => void;
  /** Errors in the address. */
  errors: () => string;
  setErrors: (errors: string) => void;
  beforeLeaving: (act: () => void) => void;
  banner: (message: string | null, about: "server" | "address" | "design") => void;
  say: (message: string) => void;
  /** Use a sensor in the tab Look: its file and its name. */
  lookThrough: (file: Blob, name: string) => Promise<void>;
}
