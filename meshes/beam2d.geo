// A straight beam along x in the plane: 0 <= x <= length, -height/2 <= y <= height/2, clamped side (root) at x = 0.
// Groups: solid (the body), root (the edge x = 0), tip (the edge x = length), load (the cross-section x = load_at*length).

DefineConstant[
  length = 2.54,         // m
  height = 0.0254,       // m, in the direction of bending
  elements_along = 20,   // along the axis; the section `load` follows element round(load_at*elements_along)
  elements_through = 1,  // through the height
  load_at = 0.7,         // place of the section `load`, as a fraction of the length
  structured = 1         // 1: quadrilaterals, 0: each cut into two triangles
];

wrong = 0;
If (!(length > 0)) Error("geometry.parameters.length = %g: must be greater than 0", length); wrong = 1; EndIf
If (!(height > 0)) Error("geometry.parameters.height = %g: must be greater than 0", height); wrong = 1; EndIf
If (elements_along < 2 || elements_along != Floor(elements_along))
  Error("geometry.parameters.elements_along = %g: must be a whole number of at least 2", elements_along); wrong = 1;
EndIf
If (elements_through < 1 || elements_through != Floor(elements_through))
  Error("geometry.parameters.elements_through = %g: must be a whole number of at least 1", elements_through); wrong = 1;
EndIf
before = Floor(load_at*elements_along + 0.5);
If (load_at <= 0 || load_at >= 1 || before < 1 || before > elements_along - 1)
  Error("geometry.parameters.load_at = %g: must lie between 0 and 1 with at least one of the %g elements on each side",
        load_at, elements_along); wrong = 1;
EndIf
If (wrong)
  Abort;
EndIf

// The edges x = const, from the root to the tip, and the two faces between them.
root = 1; load = 2; tip = 3;
x[] = {0, load_at*length, length};
For i In {0:2}
  Point(2*i + 1) = {x[i], -height/2, 0};
  Point(2*i + 2) = {x[i], height/2, 0};
  Line(i + 1) = {2*i + 1, 2*i + 2};
EndFor
Line(4) = {1, 3};  Line(5) = {2, 4};
Line(6) = {3, 5};  Line(7) = {4, 6};
Curve Loop(1) = {4, load, -5, -root};  Plane Surface(1) = {1};
Curve Loop(2) = {6, tip, -7, -load};   Plane Surface(2) = {2};

Transfinite Curve {root, load, tip} = elements_through + 1;
Transfinite Curve {4, 5} = before + 1;
Transfinite Curve {6, 7} = elements_along - before + 1;
Transfinite Surface {:} Alternate;
If (structured)
  Recombine Surface {:};
EndIf

Physical Surface("solid") = {1, 2};
Physical Curve("root") = {root};
Physical Curve("load") = {load};
Physical Curve("tip") = {tip};
