// Two strips along x in the plane that lie on one another over a length `overlap` and share no node. The lower one
// begins at x = 0, where it is clamped (root); the upper one lies on its other end. Two bolts stand at a quarter and
// three quarters of the overlap; each washer covers a sixth of it.
// Groups: solid (both strips), root, tip (the free end of the upper strip), lower and upper (the faces that touch),
// head1, nut1, head2 and nut2 (below the head and the nut of each bolt).

DefineConstant[
  length = 0.3,          // m, of each strip
  height = 0.01,         // m, of each strip
  overlap = 0.1,         // m
  elements_along = 24,   // of each strip, beside the overlap
  elements_overlap = 12, // along the overlap of the upper strip, a multiple of 6
  elements_lower = 12,   // along the overlap of the lower strip, a multiple of 6
  elements_through = 2,  // through the height of each strip
  structured = 1         // 1: quadrilaterals, 0: each cut into two triangles
];

wrong = 0;
If (!(height > 0)) Error("geometry.parameters.height = %g: must be greater than 0", height); wrong = 1; EndIf
If (!(overlap > 0 && overlap < length))
  Error("geometry.parameters.overlap = %g: must be between 0 and the length of %g", overlap, length); wrong = 1;
EndIf
If (elements_along < 1 || elements_along != Floor(elements_along))
  Error("geometry.parameters.elements_along = %g: must be a whole number of at least 1", elements_along); wrong = 1;
EndIf
If (elements_overlap < 6 || elements_overlap/6 != Floor(elements_overlap/6))
  Error("geometry.parameters.elements_overlap = %g: must be a multiple of 6", elements_overlap); wrong = 1;
EndIf
If (elements_lower < 6 || elements_lower/6 != Floor(elements_lower/6))
  Error("geometry.parameters.elements_lower = %g: must be a multiple of 6", elements_lower); wrong = 1;
EndIf
If (elements_through < 1 || elements_through != Floor(elements_through))
  Error("geometry.parameters.elements_through = %g: must be a whole number of at least 1", elements_through); wrong = 1;
EndIf
If (wrong)
  Abort;
EndIf

// Each strip has six parts. Points that coincide stay two points: gmsh joins them after a copy or an extrusion only.
start = length - overlap; e = overlap/12;
For strip In {0:1}
  n = (strip == 0 ? elements_lower : elements_overlap)/12;
  x[] = {start, start + 2*e, start + 4*e, start + 8*e, start + 10*e, length};
  cells[] = {2*n, 2*n, 4*n, 2*n, 2*n};
  If (strip == 0)
    x[] = {0, x[]};  cells[] = {elements_along, cells[]};
  Else
    x[] = {x[], length + start};  cells[] = {cells[], elements_along};
  EndIf
  p = 100*strip;
  For i In {0:6}
    Point(p + 2*i + 1) = {x[i], strip*height, 0};
    Point(p + 2*i + 2) = {x[i], (strip + 1)*height, 0};
    Line(p + i + 1) = {p + 2*i + 1, p + 2*i + 2};
    Transfinite Curve {p + i + 1} = elements_through + 1;
  EndFor
  For i In {0:5}
    Line(p + 11 + i) = {p + 2*i + 1, p + 2*i + 3};
    Line(p + 21 + i) = {p + 2*i + 2, p + 2*i + 4};
    Transfinite Curve {p + 11 + i, p + 21 + i} = cells[i] + 1;
    Curve Loop(p + i + 1) = {p + 11 + i, p + i + 2, -(p + 21 + i), -(p + i + 1)};
    Plane Surface(p + i + 1) = {p + i + 1};
  EndFor
EndFor
Transfinite Surface {:} Alternate;
If (structured)
  Recombine Surface {:};
EndIf

Physical Surface("solid") = {1:6, 101:106};
Physical Curve("root") = {1};
Physical Curve("tip") = {107};
Physical Curve("lower") = {21:26};
Physical Curve("upper") = {111:116};
Physical Curve("nut1") = {13};
Physical Curve("nut2") = {15};
Physical Curve("head1") = {122};
Physical Curve("head2") = {124};
