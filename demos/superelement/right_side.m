% The rate y' of the state y = [q; q'] of a reduced model, for ode15s of MATLAB or lsode of Octave:
%
%     M q'' + C q' + f(q) = L s - Bc' F
%
% fenicsrom export out/reduced_model.npz --format mat --output model.mat
% model = load('model.mat');
% [t, y] = ode15s(@(t, y) right_side(y, model, 111.29 * sin(2 * pi * 3.2 * t)), [0 1], zeros(2 * size(model.M, 1), 1));
%
% y: (2 n) coordinates and velocities; s: the size of each load, static loads included; F: the forces of the contact points
% on their surfaces, in the local frames [normal, tangents]. All in SI units.
function rate = right_side(y, model, s, F)
  n = size(model.M, 1);
  q = y(1:n);
  v = y(n+1:2*n);
  f = model.coefficients * prod(bsxfun(@power, q', model.exponents), 2);
  p = model.loads * s(:) - model.C * v - f;
  if nargin > 3
    p = p - model.contact_rows' * F(:);
  end
  rate = [v; model.M \ p];
end
