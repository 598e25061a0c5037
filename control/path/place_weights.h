// Weights of what speaks for a place on a path: one set for the live place and for the alignment of whole trials.
#pragma once

namespace haptrace {

/// Weights in the costs of PlaceEvidence, of which align_with_path() is the same with a look back. All lengths are
/// those of a path whose box has this diagonal, and scale with it.
struct PlaceWeights {
  double diagonal = 0.11;     ///< [m]
  double distance = 50;       ///< w_d [1/m]
  double sigma = 4e-3;        ///< distance beyond which the cost grows in proportion to it [m]
  double lambda = 0.03;       ///< movement over which a distance is forgotten [m]
  double heading = 150;       ///< w_h [1/m]
  double skip = 50;           ///< w_skip [1/m]
  double back = 60;           ///< w_back [1/m]
  double reversal = 0.8;      ///< part of the heading's cost (at most 2) of a hand that goes back along the path
  double cap = 6;             ///< cost of a restart anywhere
  double cap_kept = 4;        ///< B exceeds the least by at most this: a hand on the path is not driven off it
  double cap_behind = 0.3;    ///< added to it behind the best place
  double advance = 3;         ///< free movement ahead, relative to that of the hand
  double chord = 6e-3;        ///< of hand and path, whose directions are compared [m]
  double least_chord = 2e-3;  ///< of the hand; shorter ones have no direction [m]
};
inline constexpr PlaceWeights kPlaceWeights;

/// Returns the deviation of a heading from that of the path, 0 to 2: 1 - cos for a hand that moves forward. A hand that
/// goes back along the path deviates less than one that crosses it, or else the best place would be wherever the path
/// happens to lead the same way. `along` is the cosine between both. Real-time.
constexpr float heading_deviation(float along) noexcept {
  const float forward = 1 - along, backward = static_cast<float>(kPlaceWeights.reversal) + 1 + along;
  return forward < backward ? forward : backward;
}

}  // namespace haptrace
