/** Layers of three.js: which camera sees what. Layer 0 is seen at every level of detail. */

export const CASTERS = 1; // what casts a shadow
export const FINE = 2; // meshes for close looks
export const COARSE = 3; // the same bodies with a third of the triangles
