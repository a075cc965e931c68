/** A layer: things of the scene that are built anew together. */

import { Group, type Material, type Object3D } from "three";

type Drawn = Object3D & { geometry?: { dispose(): void }; material?: Material | Material[] };

/** Things that are replaced together, and freed when they are. */
export class Layer {
  readonly root = new Group();

  /** Replaces everything. */
  show(things: readonly Object3D[]): void {
    this.clear();
    if (things.length) this.root.add(...things);
  }

  clear(): void {
    this.root.traverse((thing: Drawn) => {
      thing.geometry?.dispose();
      for (const material of [thing.material ?? []].flat()) material.dispose();
    });
    this.root.clear();
  }
}
