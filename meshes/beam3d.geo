// A straight beam along x: 0 <= x <= length, -height/2 <= y <= height/2, -width/2 <= z <= width/2.
// Groups: solid (the body), root (the face x = 0), tip (the face x = length), load (the cross-section x = load_at*length).

DefineConstant[
  length = 2.54,         // m
  height = 0.0254,       // m, in the direction of bending
  width = 0.0254,        // m, along z
  elements_along = 20,   // along the axis; the section `load` follows element round(load_at*elements_along)
  elements_through = 1,  // through the height and through the width
  load_at = 0.7,         // place of the section `load`, as a fraction of the length
  structured = 1         // 1: hexahedra, 0: each cut into tetrahedra
];

wrong = 0;
If (!(length > 0)) Error("geometry.parameters.length = %g: must be greater than 0", length); wrong = 1; EndIf
If (!(height > 0)) Error("geometry.parameters.height = %g: must be greater than 0", height); wrong = 1; EndIf
If (!(width > 0)) Error("geometry.parameters.width = %g: must be greater than 0", width); wrong = 1; EndIf
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

// The cross-sections are extruded from one another: root -> load -> tip.
For i In {0:3}
  Point(i + 1) = {0, (i == 0 || i == 3 ? -height/2 : height/2), (i < 2 ? -width/2 : width/2)};
EndFor
Line(1) = {1, 2};  Line(2) = {2, 3};  Line(3) = {3, 4};  Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
root = 1; Plane Surface(root) = {1};
Transfinite Curve {1:4} = elements_through + 1;
Transfinite Surface {root};
If (structured)
  Recombine Surface {root};
EndIf
section = root;
size[] = {load_at*length, (1 - load_at)*length};
elements[] = {before, elements_along - before};
For i In {0:1}
  If (structured)
    piece[] = Extrude {size[i], 0, 0} { Surface{section}; Layers{elements[i]}; Recombine; };
  Else
    piece[] = Extrude {size[i], 0, 0} { Surface{section}; Layers{elements[i]}; };
  EndIf
  section = piece[0];
  sections[i] = piece[0];
  body[i] = piece[1];
EndFor

Physical Volume("solid") = body[];
Physical Surface("root") = {root};
Physical Surface("load") = {sections[0]};
Physical Surface("tip") = {sections[1]};
