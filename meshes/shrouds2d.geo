// One sector of a plane disk about the origin: a ring, a blade along y, and a shroud at its tip, which shares no node with
// those of its neighbours. One end of the shroud lies on the inner half of the next one, with a slit at the ends.
// Groups: solid (the body), left and right (the cut edges of the ring), bore (the inner edge of the ring), ahead (under the
// lip at one end) and behind (on the lip at the other end), which touch those of the neighbours, tip (the outer edge).

SetFactory("OpenCASCADE");

DefineConstant[
  sectors = 24,        // sectors of the disk
  bore = 0.1,          // m, inner radius of the ring
  rim = 0.2,           // m, outer radius of the ring
  tip = 0.4,           // m, outer radius of the shroud
  thickness = 0.016,   // m, of the blade
  shroud = 0.01,       // m, of the shroud along the radius
  lap = 0.02,          // m, length over which neighbours touch
  slit = 0.005,        // m, between the end of a lip and the neighbour
  size = 0.01,         // m, of the cells
  structured = 0       // cells are triangles
];

wrong = 0;
If (sectors < 3 || sectors != Floor(sectors))
  Error("geometry.parameters.sectors = %g: must be a whole number of at least 3", sectors); wrong = 1;
EndIf
If (!(0 < bore && bore < rim && rim < tip - shroud && shroud > 0))
  Error("geometry.parameters.tip = %g: must be greater than rim + shroud, and rim greater than bore", tip); wrong = 1;
EndIf
If (!(thickness > 0 && thickness < 2*rim*Sin(Pi/sectors)))
  Error("geometry.parameters.thickness = %g: must be positive, and less than the sector is wide", thickness); wrong = 1;
EndIf
If (!(lap > 0 && slit > 0 && lap + 2*slit + thickness < 2*Pi/sectors*(tip - shroud)))
  Error("geometry.parameters.lap = %g: must leave a part of the sector to the blade", lap); wrong = 1;
EndIf
If (wrong)
  Abort;
EndIf

a = 2*Pi/sectors; q = Pi/2; inner = tip - shroud; middle = tip - shroud/2;
l = lap/2/middle; s = slit/middle; e = 1e-6*tip;

// Corners in polar coordinates: the ring, then the shroud.
r[] = {bore, bore, rim, rim, inner, inner, middle, middle, tip, tip, middle, middle};
t[] = {-a/2, a/2, a/2, -a/2, -a/2 - l, a/2 - l - s, a/2 - l - s, a/2 + l, a/2 + l, -a/2 + l + s, -a/2 + l + s, -a/2 - l};
Point(100) = {0, 0, 0};
For k In {0:11}
  Point(k) = {r[k]*Cos(q + t[k]), r[k]*Sin(q + t[k]), 0};
EndFor
For k In {0:11}
  next = (k == 3 ? 0 : (k == 11 ? 4 : k + 1));
  If (r[k] == r[next])
    Circle(k) = {k, 100, next};
  Else
    Line(k) = {k, next};
  EndIf
EndFor
Curve Loop(1) = {0:3};
Curve Loop(2) = {4:11};
Plane Surface(1) = {1};
Plane Surface(2) = {2};
Rectangle(3) = {-thickness/2, rim - thickness, 0, thickness, middle - rim + thickness};
body[] = BooleanUnion{ Surface{1, 2}; Delete; }{ Surface{3}; Delete; };

// The edges, by boxes about them.
c = Cos(a/2); s2 = Sin(a/2); from = middle*Sin(a/2 - l - s) - e; to = middle*Sin(a/2 + l) + e;
low = middle*Cos(a/2 + l) - e; high = middle*Cos(a/2 - l - s) + e;
left[] = Curve In BoundingBox {-rim*s2 - e, bore*c - e, -e, -bore*s2 + e, rim*c + e, e};
right[] = Curve In BoundingBox {bore*s2 - e, bore*c - e, -e, rim*s2 + e, rim*c + e, e};
bored[] = Curve In BoundingBox {-bore*s2 - e, bore*c - e, -e, bore*s2 + e, bore + e, e};
ahead[] = Curve In BoundingBox {-to, low, -e, -from, high, e};
behind[] = Curve In BoundingBox {from, low, -e, to, high, e};
outer[] = Curve In BoundingBox {-to/middle*tip, low/middle*tip, -e, to, tip + e, e};
outer[] -= {ahead[]};

Periodic Curve {left[]} = {right[]} Rotate {{0, 0, 1}, {0, 0, 0}, a};
Physical Surface("solid") = {body[]};
Physical Curve("left") = {left[]};
Physical Curve("right") = {right[]};
Physical Curve("bore") = {bored[]};
Physical Curve("ahead") = {ahead[]};
Physical Curve("behind") = {behind[]};
Physical Curve("tip") = {outer[]};
MeshSize {:} = size;
