// Saves a file where the browser keeps its downloads.

const KEPT_MS = 1000; // some browsers read a file only after the click

export function save(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = `fling-${name}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), KEPT_MS);
}
