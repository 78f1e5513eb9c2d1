// A panel of a circular cylinder about z: an arc of length `arc` on the middle surface, from z = 0 to `length`.
// Groups: solid (the body), root (the curved edge z = 0).

DefineConstant[
  radius = 0.6096, arc = 0.3048, length = 0.3048, thickness = 0.003048, // m
  cells = 8 // along the arc and along the axis
];

Point(1) = {0, 0, 0};
For side In {0:1}
  r = radius + (side - 0.5)*thickness;
  For end In {0:1}
    angle = Pi/2 + (end - 0.5)*arc/radius;
    Point(2 + 2*side + end) = {r*Cos(angle), r*Sin(angle), 0};
  EndFor
EndFor
Circle(1) = {2, 1, 3};  Line(2) = {3, 5};  Circle(3) = {5, 1, 4};  Line(4) = {4, 2};
Curve Loop(1) = {1, 2, 3, 4};  Plane Surface(1) = {1};
Transfinite Curve {1, 3} = cells + 1;
Transfinite Curve {2, 4} = 2;
Transfinite Surface {1};
Recombine Surface {1};
body[] = Extrude {0, 0, length} { Surface{1}; Layers{cells}; Recombine; };

Physical Volume("solid") = {body[1]};
Physical Surface("root") = {1};
