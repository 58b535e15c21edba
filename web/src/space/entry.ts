import type { Host } from "./host";
import sheet from "./space.css?inline";
import { SpaceView } from "./view";

/** Create the 3-D view; null without WebGL2. */
export function begin(host: Host): SpaceView | null {
  const styleSheet = new CSSStyleSheet();
  styleSheet.replaceSync(sheet);
  document.adoptedStyleSheets = [...document.adoptedStyleSheets, styleSheet];
  const gl = document
    .createElement("canvas")
    .getContext("webgl2", { alpha: false, antialias: true });
  return gl && new SpaceView(host, gl);
}
