// The keyboard's place: where the control that has it goes away, it stays in what contained that.

const FOCUSABLE = "button:not(:disabled), summary, a[href], input:not(:disabled), select:not(:disabled), [tabindex]";

/** Keeps the focus of a person at the keyboard within `root`. */
export function keepFocus(root: HTMLElement): void {
  let way: Element[] = []; // from the control to the root; empty where a pointer put the focus there
  root.addEventListener("focusin", ({ target }) => {
    const control = target as Element;
    way = control.matches(":focus-visible") ? ancestorsOf(control, root) : [];
  });
  new MutationObserver(() => {
    if (document.activeElement !== document.body || way.length === 0 || way[0]!.isConnected) return;
    const left = way.filter((element) => element.isConnected);
    way = [];
    for (const element of left) {
      element.querySelector<HTMLElement>(FOCUSABLE)?.focus();
      if (document.activeElement !== document.body) return;
    }
  }).observe(root, { childList: true, subtree: true });
}

function ancestorsOf(element: Element, root: Element): Element[] {
  const way = [element];
  while (way.at(-1) !== root && way.at(-1)?.parentElement) way.push(way.at(-1)!.parentElement!);
  return way;
}
