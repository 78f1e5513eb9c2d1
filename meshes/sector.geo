// One sector of a bladed disk: a disk of constant width about the axis x, with a plate as its blade, which points along y.
// The cut faces are planes through the axis; their meshes match.
// Groups: solid (the body), left and right (the cut faces), bore (the inner face of the disk), tip (the end of the blade).

SetFactory("OpenCASCADE");

DefineConstant[
  sectors = 24,        // sectors of the disk
  bore = 0.1,          // m, inner radius of the disk
  rim = 0.2,           // m, outer radius of the disk
  tip = 0.4,           // m, radius of the end of the blade
  width = 0.03,        // m, of the disk along the axis
  chord = 0.03,        // m
  thickness = 0.004,   // m, of the blade
  stagger = 30,        // degrees, of the blade about its span
  size = 0.012,        // m, of the cells
  structured = 0       // cells are tetrahedra
];

a = 2 * Pi / sectors; e = 1e-6 * tip;
Rectangle(1) = {-width / 2, bore, 0, width, rim - bore};
Rotate {{1, 0, 0}, {0, 0, 0}, -a / 2} { Surface{1}; }
disk[] = Extrude {{1, 0, 0}, {0, 0, 0}, a} { Surface{1}; };
Box(2) = {-chord / 2, rim - width / 4, -thickness / 2, chord, tip - rim + width / 4, thickness};
Rotate {{0, 1, 0}, {0, 0, 0}, stagger * Pi / 180} { Volume{2}; }
body[] = BooleanUnion{ Volume{disk[1]}; Delete; }{ Volume{2}; Delete; };

c = Cos(a / 2); s = Sin(a / 2); w = width / 2 + e;
left[] = Surface In BoundingBox {-w, bore * c - e, -rim * s - e, w, rim * c + e, -bore * s + e};
right[] = Surface In BoundingBox {-w, bore * c - e, bore * s - e, w, rim * c + e, rim * s + e};
bored[] = Surface In BoundingBox {-w, bore * c - e, -bore * s - e, w, bore + e, bore * s + e};
ends[] = Surface In BoundingBox {-tip, tip - e, -tip, tip, tip + e, tip};
Periodic Surface {right[]} = {left[]} Rotate {{1, 0, 0}, {0, 0, 0}, a};

Physical Volume("solid") = {body[]};
Physical Surface("left") = {left[]};
Physical Surface("right") = {right[]};
Physical Surface("bore") = {bored[]};
Physical Surface("tip") = {ends[]};
MeshSize {:} = size;
