// Fit of a hand and a flexible link to the response at the spectral lines.
#pragma once

#include "control/design/held_model.h"
#include "control/design/line_spectrum.h"

namespace haptrace {

/// Parts of the model beside mass and viscous damping.
struct HandFitParts {
  bool hand = false, link = false;
};

struct HandFit {
  HeldModel held;        ///< without noise; a mass is 1 / (M^-1)_ii
  HeldModel half_width;  ///< half widths of the 95 % confidence intervals
  double evidence = 0;   ///< -2 ln of the probability of the data under the model, up to a constant of the data
  double residual = 1;   ///< unexplained fraction of the response, rms, weighted as in the fit
};

/// Fits, for each axis of `axes`, the response at the lines
///
///     X = (M s^2 + diag(b s + z))^-1 e^{-s periods T} hold(s) / (1 + s lag) U
///
/// with a symmetric mass matrix M, viscous damping b, and as z the hand of HandModel with the arm's constants of
/// HandModel, behind the link if `parts` has one:
///
///     z = (k_g + b_g s) || (m_h s^2 + b_a s + k_a s tau / (1 + s tau)),   a || b = a b / (a + b)
///
/// Levenberg-Marquardt; positive parameters are logarithms and have wide normal priors. The priors also keep the axes
/// alike, since one hand holds all of them. A line is weighted by the noise of the positions, by a share of the
/// response that the model cannot explain, and by a force of the hand that grows towards low frequencies. The shares of
/// the latter two come from the residuals. The evidence is Laplace's approximation (MacKay 1992, Neural Computation
/// 4(3)): it counts only the parameters that the data determine.
///
/// `mass` starts the search: the apparent mass at the highest lines, positive on every axis of `axes` [kg]. Not
/// real-time: it allocates.
HandFit fit_hand(const LineSpectrum& spectrum, const std::array<bool, 3>& axes, double rate_hz, int periods,
                 const Vec3& mass, HandFitParts parts);

}  // namespace haptrace
