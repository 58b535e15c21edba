interface Size {
  width: number;
  height: number;
}

/**
 * How large elements are, as the browser tells when it has laid them out: asking it itself makes it lay out all of the page
 * at once, for every plot that is drawn anew.
 */
export class Sizes {
  private readonly known = new Map<Element, Size>();

  /** Tells when an element has become wider, or narrower; with `hasHeights` also when it has become higher, or lower. */
  constructor(elements: readonly Element[], hasHeights: boolean, changed: () => void) {
    const observer = new ResizeObserver((entries) => {
      let isOther = false;
      for (const { target, borderBoxSize } of entries) {
        const [{ inlineSize: width, blockSize: height }] = borderBoxSize;
        const before = this.known.get(target);
        isOther ||= before?.width !== width || (hasHeights && before.height !== height);
        this.known.set(target, { width, height });
      }
      if (isOther) changed();
    });
    for (const element of elements) observer.observe(element);
  }

  of(element: Element): Size {
    return this.known.get(element) ?? element.getBoundingClientRect();
  }
}
