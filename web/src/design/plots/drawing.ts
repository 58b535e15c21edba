import { svg } from "../../shared/dom";

type Attributes = Readonly<Record<string, string | number>>;

/** Drawn element with its attributes. */
interface Shape {
  tag: string;
  element: SVGElement;
  attributes: Attributes;
  words: Text | null;
}

/**
 * Shapes of a drawing that is updated frequently. Elements are reused and only changed attributes are set, because
 * browsers recompute style and layout of new elements.
 */
export class Drawing {
  private readonly shapes: Shape[] = [];
  private count = 0;

  constructor(private readonly place: SVGElement) {}

  /** Start a new drawing with the given size in px. */
  begin(width: number, height: number): void {
    const box = `0 0 ${width} ${height}`;
    if (this.place.getAttribute("viewBox") !== box) this.place.setAttribute("viewBox", box);
    this.count = 0;
  }

  /** Draw a shape above the previous ones. A `text` displays its text, all others as a tooltip. */
  add(tag: string, attributes: Attributes, words: string | null = null): void {
    let shape = this.shapes[this.count];
    if (shape?.tag !== tag || (shape.words === null) !== (words === null))
      shape = this.make(tag, words);
    for (const name in attributes)
      if (attributes[name] !== shape.attributes[name])
        shape.element.setAttribute(name, String(attributes[name]));
    for (const name in shape.attributes)
      if (!(name in attributes)) shape.element.removeAttribute(name);
    shape.attributes = attributes;
    if (shape.words && shape.words.data !== words) shape.words.data = words!;
    this.count++;
  }

  /** Finish the drawing: remove surplus elements. */
  end(): void {
    for (const { element } of this.shapes.splice(this.count)) element.remove();
  }

  private make(tag: string, text: string | null): Shape {
    const words = text === null ? null : document.createTextNode(text);
    const element = svg(tag, {}, words && tag !== "text" ? svg("title", {}, words) : words);
    const [last, old] = [this.shapes[this.count - 1], this.shapes[this.count]];
    if (old) old.element.replaceWith(element);
    else if (last) last.element.after(element);
    else this.place.prepend(element);
    return (this.shapes[this.count] = { tag, element, attributes: {}, words });
  }
}
