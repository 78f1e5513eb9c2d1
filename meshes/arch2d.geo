// A shallow circular arch over the x axis in the plane: its axis goes from (-span/2, 0) over (0, rise) to (span/2, 0).
// Groups: solid (the body), left and right (the ends), crown (the section at the top), outer (the upper side).

DefineConstant[
  span = 0.5,            // m, between the ends of the axis
  rise = 0.02,           // m, of the axis
  thickness = 0.005,     // m, in the direction of bending
  elements_along = 16,   // along the axis, an even number: a section of nodes is at the crown
  elements_through = 1,  // through the thickness
  structured = 1         // 1: quadrilaterals, 0: each cut into two triangles
];

wrong = 0;
If (!(span > 0)) Error("geometry.parameters.span = %g: must be greater than 0", span); wrong = 1; EndIf
If (!(rise > 0 && rise <= span/2))
  Error("geometry.parameters.rise = %g: must be greater than 0 and at most span/2 = %g", rise, span/2); wrong = 1;
EndIf
If (!(thickness > 0 && thickness < rise + span))
  Error("geometry.parameters.thickness = %g: must be greater than 0 and small against the span", thickness); wrong = 1;
EndIf
If (elements_along < 2 || elements_along/2 != Floor(elements_along/2))
  Error("geometry.parameters.elements_along = %g: must be an even number of at least 2", elements_along); wrong = 1;
EndIf
If (elements_through < 1 || elements_through != Floor(elements_through))
  Error("geometry.parameters.elements_through = %g: must be a whole number of at least 1", elements_through); wrong = 1;
EndIf
If (wrong)
  Abort;
EndIf

// The sections at the left end, the crown and the right end, and the arcs between them.
radius = (span^2/4 + rise^2)/(2*rise);
centre = rise - radius;
Point(1) = {0, centre, 0};
x[] = {-span/2, 0, span/2};  y[] = {-centre, radius, -centre};  // from the centre
For i In {0:2}
  For side In {0:1}
    part = 1 + (side - 0.5)*thickness/radius;
    Point(2 + 2*i + side) = {part*x[i], centre + part*y[i], 0};
  EndFor
  Line(i + 1) = {2 + 2*i, 3 + 2*i};
EndFor
Circle(4) = {2, 1, 4};  Circle(5) = {3, 1, 5};
Circle(6) = {4, 1, 6};  Circle(7) = {5, 1, 7};
Curve Loop(1) = {4, 2, -5, -1};  Plane Surface(1) = {1};
Curve Loop(2) = {6, 3, -7, -2};  Plane Surface(2) = {2};

Transfinite Curve {1, 2, 3} = elements_through + 1;
Transfinite Curve {4, 5, 6, 7} = elements_along/2 + 1;
Transfinite Surface {:} Alternate;
If (structured)
  Recombine Surface {:};
EndIf

Physical Surface("solid") = {1, 2};
Physical Curve("left") = {1};
Physical Curve("crown") = {2};
Physical Curve("right") = {3};
Physical Curve("outer") = {5, 7};
