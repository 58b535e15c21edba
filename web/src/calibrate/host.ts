/** What the tab needs of the page around it. */
export interface Host {
  place: HTMLElement;
  header: HTMLElement;
  isShown: () => boolean;
  banner: (sentence: string | null, about: "server" | "calibrate") => void;
  say: (sentence: string) => void;
  /** Copy a command. */
  copy: (command: string) => void;
  /** Look through a camera at a picture: the files of both, and their names. */
  lookThrough: (file: Blob, name: string, picture: Blob, pictureName: string) => Promise<void>;
}
