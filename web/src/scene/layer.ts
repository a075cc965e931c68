/** A layer: things of the scene that are built anew together. */

import { Group, type Material, type Object3D } from "three";

type Drawn = Object3D & { geometry?: { dispose(): void }; material?: Material | Material[] };

/** Things that are replaced together. */
export class Layer {
  readonly root = new Group();
  private retired: Object3D[] = [];

  /** Replaces everything. */
  show(things: readonly Object3D[]): void {
    this.retired.push(...this.root.children);
    this.root.clear();
    if (things.length) this.root.add(...things);
  }

  /** Frees what was replaced; after a frame, or the programs that the new things share with it would be built anew. */
  sweep(): void {
    for (const thing of this.retired) free(thing);
    this.retired = [];
  }

  clear(): void {
    this.show([]);
    this.sweep();
  }
}

function free(thing: Object3D): void {
  thing.traverse(({ geometry, material }: Drawn) => {
    geometry?.dispose();
    for (const each of [material ?? []].flat()) each.dispose();
  });
}
