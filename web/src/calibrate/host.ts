/** Interface of the page for the tab. */
export interface Host {
  place: HTMLElement;
  header: HTMLElement;
  isShown: () => boolean;
  banner: (message: string | null, about: "server" | "calibrate") => void;
  say: (message: string) => void;
  /** Copy a command. */
  copy: (command: string) => void;
  /** Open an image with a camera: the files of both, and their names. */
  lookThrough: (file: Blob, name: string, image: Blob, imageName: string) => Promise<void>;
}
