import { svg } from "../../shared/dom";

type Attributes = Readonly<Record<string, string | number>>;

/** An element that is drawn, and what it was drawn from. */
interface Shape {
  tag: string;
  element: SVGElement;
  attributes: Attributes;
  words: Text | null;
}

/**
 * The shapes of a drawing that is drawn again and again. What is like the shape before in its place is kept, and only what
 * differs in it is changed: of elements that are new a browser looks for style and room anew.
 */
export class Drawing {
  private readonly shapes: Shape[] = [];
  private count = 0;

  constructor(private readonly place: SVGElement) {}

  /** Draw all anew, in a box of so many px. */
  begin(width: number, height: number): void {
    const box = `0 0 ${width} ${height}`;
    if (this.place.getAttribute("viewBox") !== box) this.place.setAttribute("viewBox", box);
    this.count = 0;
  }

  /** Draw a shape over those before. Words are written by a `text`, and told by all others to whoever points at them. */
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

  /** All is drawn: what there was more before goes. */
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
