// A thin twisted and tapered fan blade, span along x: 0 <= x <= span, clamped at x = 0. Sections are NACA four-digit
// profiles in planes x = const, their thickness perpendicular to the camber line and blunt at both edges. The chord of a
// section runs from the leading to the trailing edge along y at stagger 0, and is turned about x by its stagger, from y
// towards z. The middles of the chords lie on the curve y = sweep*(x/span)^2, z = lean*(x/span)^2. Everything else is linear in x.
// A tip_radius grinds the tip to a cylinder about an axis along y, to fit a casing. The sections then bend like the tip,
// but less and less towards the root.
// Groups: solid (the body), root (the face x = 0), tip (the face x = span), load (the section x = load_at*span), pressure
// and suction (the hollow and the bulging side); of nodes: tip_nodes (the edge of the tip on the pressure side, from the
// leading to the trailing edge).

DefineConstant[
  span = 0.7,             // m
  chord = 0.2,            // m, at the root
  tip_chord = 0.15,       // m
  thickness = 0.08,       // largest thickness at the root, as a fraction of the chord
  tip_thickness = 0.03,   // largest thickness at the tip, as a fraction of the chord there
  camber = 0.04,          // largest camber, as a fraction of the chord
  camber_at = 0.4,        // place of the largest camber, as a fraction of the chord
  edge = 0.25,            // thickness at the leading and trailing edges, as a fraction of the largest
  stagger = 15,           // degrees, at the root
  twist = 35,             // degrees, from the root to the tip
  sweep = 0.03,           // m, at the tip, along y
  lean = 0,               // m, at the tip, along z
  tip_radius = 0,         // m, radius of the cylinder about (span - tip_radius, 0, 0) on which the tip lies; 0: a plane tip
  elements_along = 12,    // along the span; the section `load` follows element round(load_at*elements_along)
  elements_across = 8,    // along the chord; a thinner blade of curved tetrahedra needs more elements in both directions
  elements_through = 1,   // through the thickness
  load_at = 0.75,         // place of the section `load`, as a fraction of the span
  structured = 1          // 1: hexahedra, 0: each cut into tetrahedra
];

wrong = 0;
If (!(span > 0)) Error("geometry.parameters.span = %g: must be greater than 0", span); wrong = 1; EndIf
If (!(chord > 0)) Error("geometry.parameters.chord = %g: must be greater than 0", chord); wrong = 1; EndIf
If (!(tip_chord > 0)) Error("geometry.parameters.tip_chord = %g: must be greater than 0", tip_chord); wrong = 1; EndIf
If (!(thickness > 0) || thickness > 0.3)
  Error("geometry.parameters.thickness = %g: must be greater than 0 and at most 0.3", thickness); wrong = 1;
EndIf
If (!(tip_thickness > 0) || tip_thickness > 0.3)
  Error("geometry.parameters.tip_thickness = %g: must be greater than 0 and at most 0.3", tip_thickness); wrong = 1;
EndIf
If (camber < 0 || camber > 0.2)
  Error("geometry.parameters.camber = %g: must be from 0 to 0.2", camber); wrong = 1;
EndIf
If (camber_at < 0.1 || camber_at > 0.9)
  Error("geometry.parameters.camber_at = %g: must be from 0.1 to 0.9", camber_at); wrong = 1;
EndIf
If (edge < 0.02 || edge > 1)
  Error("geometry.parameters.edge = %g: must be from 0.02 to 1", edge); wrong = 1;
EndIf
If (Fabs(stagger) > 90) Error("geometry.parameters.stagger = %g: must be from -90 to 90", stagger); wrong = 1; EndIf
If (Fabs(twist) > 90) Error("geometry.parameters.twist = %g: must be from -90 to 90", twist); wrong = 1; EndIf
If (Fabs(sweep) > span) Error("geometry.parameters.sweep = %g: must be at most the span, %g", sweep, span); wrong = 1; EndIf
If (Fabs(lean) > span) Error("geometry.parameters.lean = %g: must be at most the span, %g", lean, span); wrong = 1; EndIf
If (tip_radius < 0 || (tip_radius > 0 && tip_radius < span))
  Error("geometry.parameters.tip_radius = %g: must be 0 or at least the span, %g", tip_radius, span); wrong = 1;
EndIf
If (elements_along < 2 || elements_along != Floor(elements_along))
  Error("geometry.parameters.elements_along = %g: must be a whole number of at least 2", elements_along); wrong = 1;
EndIf
If (elements_across < 1 || elements_across != Floor(elements_across))
  Error("geometry.parameters.elements_across = %g: must be a whole number of at least 1", elements_across); wrong = 1;
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

// One section for each layer of elements, and only the four corners between two sections, so that the edges bend. A section
// has points 0 to m on its pressure side (s = 0) and on its suction side (s = 1), closer together at the edges.
m = 4*elements_across;
layers = 2*elements_along;
For j In {0:layers}
  If (j <= 2*before)
    t = load_at*j/(2*before);
  Else
    t = load_at + (1 - load_at)*(j - 2*before)/(layers - 2*before);
  EndIf
  c = chord + (tip_chord - chord)*t;
  largest = thickness + (tip_thickness - thickness)*t;
  angle = (stagger + twist*t)*Pi/180;
  step = (j % 2) ? m : 1;
  For s In {0:1}
    For i In {0:m:step}
      u = 0.5*(1 - Cos(Pi*i/m));
      round = (0.2969*Sqrt(u) - 0.126*u - 0.3516*u^2 + 0.2843*u^3 - 0.1036*u^4)/0.10;
      half = 0.5*largest*(edge + (1 - edge)*round);
      front = (u < camber_at);
      k = front ? camber/camber_at^2 : camber/(1 - camber_at)^2;
      line = k*(front ? 2*camber_at*u - u^2 : 1 - 2*camber_at + 2*camber_at*u - u^2);
      slope = Atan(2*k*(camber_at - u));
      sign = s ? 1 : -1;
      y = c*(u - 0.5 - sign*half*Sin(slope));
      z = c*(line + sign*half*Cos(slope));
      across = Sin(angle)*y + Cos(angle)*z + lean*t^2;
      ground = tip_radius > 0 ? tip_radius - Sqrt(tip_radius^2 - across^2) : 0;
      p~{j}~{s}~{i} = newp;
      Point(p~{j}~{s}~{i}) = {t*(span - ground), Cos(angle)*y - Sin(angle)*z + sweep*t^2, across};
    EndFor
  EndFor
EndFor

// Curves and faces of the sections: the two sides, the leading and the trailing edge.
For j In {0:layers:2}
  For s In {0:1}
    points[] = {};
    For i In {0:m}
      points[] += p~{j}~{s}~{i};
    EndFor
    side~{j}~{s} = newc; Spline(side~{j}~{s}) = points[];
    Transfinite Curve {side~{j}~{s}} = elements_across + 1;
  EndFor
  For e In {0:1}
    end~{j}~{e} = newc; Line(end~{j}~{e}) = {p~{j}~{0}~{e*m}, p~{j}~{1}~{e*m}};
    Transfinite Curve {end~{j}~{e}} = elements_through + 1;
  EndFor
  loop = newcl; Curve Loop(loop) = {side~{j}~{0}, end~{j}~{1}, -side~{j}~{1}, -end~{j}~{0}};
  section~{j} = news;
  If (tip_radius > 0 && j > 0)
    Surface(section~{j}) = {loop};
  Else
    Plane Surface(section~{j}) = {loop};
  EndIf
EndFor

// Between two sections: four spanwise curves, four faces and a volume.
body[] = {};
pressure[] = {};
suction[] = {};
For j In {0:layers - 2:2}
  For s In {0:1}
    For e In {0:1}
      rib~{s}~{e} = newc;
      Spline(rib~{s}~{e}) = {p~{j}~{s}~{e*m}, p~{j + 1}~{s}~{e*m}, p~{j + 2}~{s}~{e*m}};
      Transfinite Curve {rib~{s}~{e}} = 2;
    EndFor
    loop = newcl; Curve Loop(loop) = {side~{j}~{s}, rib~{s}~{1}, -side~{j + 2}~{s}, -rib~{s}~{0}};
    skin~{s} = news; Surface(skin~{s}) = {loop};
  EndFor
  For e In {0:1}
    loop = newcl; Curve Loop(loop) = {end~{j}~{e}, rib~{1}~{e}, -end~{j + 2}~{e}, -rib~{0}~{e}};
    rim~{e} = news; Surface(rim~{e}) = {loop};
  EndFor
  shell = newsl; Surface Loop(shell) = {section~{j}, section~{j + 2}, skin~{0}, skin~{1}, rim~{0}, rim~{1}};
  block = newv; Volume(block) = {shell};
  body[] += block;
  pressure[] += skin~{0};
  suction[] += skin~{1};
EndFor

Transfinite Surface {:};
If (structured)
  Recombine Surface {:};
EndIf
Transfinite Volume {:};

Physical Volume("solid") = body[];
Physical Surface("root") = {section~{0}};
Physical Surface("load") = {section~{2*before}};
Physical Surface("tip") = {section~{layers}};
Physical Surface("pressure") = pressure[];
Physical Surface("suction") = suction[];
Physical Curve("tip_nodes") = {side~{layers}~{0}};
