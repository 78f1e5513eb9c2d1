// A compressor blade like that of NASA rotor 37, clamped at its root. The axis of rotation is the y axis. Six profiles lie on
// cylinders about it: at angle a = s/r from the x axis, where s is the unrolled coordinate across the axis, a point has
// x = r*cos(a), z = r*sin(a). Mean radius, chord, stagger (from the axis), largest thickness and camber of the profiles are
// those of the profiles that NASA publishes (pyturbo-aero, NOSA 1.3; after Reid and Moore, NASA TP-1337). The profiles
// themselves are made by formula: a circular camber line, and a thickness that is a parabola along the chord above the
// thickness of the blunt edges. The middles of the profiles lie on the x axis. The tip lies on the cylinder of the last profile.
// Groups: solid (the body), root, tip, pressure and suction (the hollow and the bulging side); of nodes: tip_nodes (the edge
// of the tip on the pressure side, from the leading to the trailing edge).

DefineConstant[
  edge = 0.15,            // thickness at the leading and trailing edges, as a fraction of the largest
  elements_along = 2,     // between two of the six profiles
  elements_across = 8,    // along the chord
  elements_through = 1,   // through the thickness
  structured = 1          // 1: hexahedra, 0: each cut into tetrahedra
];

wrong = 0;
If (edge < 0.02 || edge > 1)
  Error("geometry.parameters.edge = %g: must be from 0.02 to 1", edge); wrong = 1;
EndIf
If (elements_along < 1 || elements_along != Floor(elements_along))
  Error("geometry.parameters.elements_along = %g: must be a whole number of at least 1", elements_along); wrong = 1;
EndIf
If (elements_across < 1 || elements_across != Floor(elements_across))
  Error("geometry.parameters.elements_across = %g: must be a whole number of at least 1", elements_across); wrong = 1;
EndIf
If (elements_through < 1 || elements_through != Floor(elements_through))
  Error("geometry.parameters.elements_through = %g: must be a whole number of at least 1", elements_through); wrong = 1;
EndIf
If (wrong)
  Abort;
EndIf

radius[] = {0.18262, 0.19582, 0.20902, 0.22221, 0.23538, 0.24851};   // m
chord[] = {0.05561, 0.05592, 0.05613, 0.05622, 0.05619, 0.05594};    // m
stagger[] = {39.81, 43.82, 47.79, 51.69, 55.75, 60.29};              // degrees
thickness[] = {0.0813, 0.0699, 0.0597, 0.0497, 0.0404, 0.0321};      // of the chord
camber[] = {0.0899, 0.0637, 0.0458, 0.0348, 0.0272, 0.0228};         // of the chord

m = 4*elements_across;
For j In {0:5}
  bend = 0.5/camber[j]*(0.25 + camber[j]^2);   // radius of the camber line, as a fraction of the chord
  angle = stagger[j]*Pi/180;
  For s In {0:1}
    points[] = {};
    For i In {0:m}
      u = 0.5*(1 - Cos(Pi*i/m));
      half = 0.5*thickness[j]*(edge + (1 - edge)*4*u*(1 - u));
      slope = -Asin((u - 0.5)/bend);
      line = Sqrt(bend^2 - (u - 0.5)^2) - bend + camber[j];
      sign = s ? 1 : -1;
      y = chord[j]*(u - 0.5 - sign*half*Sin(slope));
      z = chord[j]*(line - 0.5*camber[j] + sign*half*Cos(slope));
      a = (Sin(angle)*y + Cos(angle)*z)/radius[j];
      p~{j}~{s}~{i} = newp;
      Point(p~{j}~{s}~{i}) = {radius[j]*Cos(a), Cos(angle)*y - Sin(angle)*z, radius[j]*Sin(a)};
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
  section~{j} = news; Surface(section~{j}) = {loop};
EndFor

// Between two profiles: four spanwise lines, four faces and a volume.
body[] = {};
pressure[] = {};
suction[] = {};
For j In {0:4}
  For s In {0:1}
    For e In {0:1}
      rib~{s}~{e} = newc; Line(rib~{s}~{e}) = {p~{j}~{s}~{e*m}, p~{j + 1}~{s}~{e*m}};
      Transfinite Curve {rib~{s}~{e}} = elements_along + 1;
    EndFor
    loop = newcl; Curve Loop(loop) = {side~{j}~{s}, rib~{s}~{1}, -side~{j + 1}~{s}, -rib~{s}~{0}};
    skin~{s} = news; Surface(skin~{s}) = {loop};
  EndFor
  For e In {0:1}
    loop = newcl; Curve Loop(loop) = {end~{j}~{e}, rib~{1}~{e}, -end~{j + 1}~{e}, -rib~{0}~{e}};
    rim~{e} = news; Surface(rim~{e}) = {loop};
  EndFor
  shell = newsl; Surface Loop(shell) = {section~{j}, section~{j + 1}, skin~{0}, skin~{1}, rim~{0}, rim~{1}};
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
Physical Surface("tip") = {section~{5}};
Physical Surface("pressure") = pressure[];
Physical Surface("suction") = suction[];
Physical Curve("tip_nodes") = {side~{5}~{0}};
