/** Interface of the page for the tab. */
export interface Host {
  place: HTMLElement;
  header: HTMLElement;
  isShown: () => boolean;
  banner: (sentence: string | null, about: "server" | "calibrate") => void;
  say: (sentence: string) => void;
  /** Copy a command. */
  copy: (command: string) => void;
  /** Open an image with a camera: the files of both, and their names. */
  lookThrough: (file: Blob, name: string, picture: Blob, pictureName: string) => Promise<void>;
}
