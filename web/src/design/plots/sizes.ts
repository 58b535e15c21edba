interface Size {
  width: number;
  height: number;
}

/**
 * Sizes of elements as reported after layout: reading them directly forces a synchronous layout of the page for every
 * plot.
 */
export class Sizes {
  private readonly known = new Map<Element, Size>();

  /** Observe changes of the width of an element; `hasHeights` includes the height. */
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
