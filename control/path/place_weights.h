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
  double back = 200;          ///< w_back [1/m]
  double cap = 6;             ///< cost of a restart anywhere
  double cap_behind = 0.3;    ///< added to it behind the best place
  double advance = 3;         ///< free movement ahead, relative to that of the hand
  double chord = 6e-3;        ///< of hand and path, whose directions are compared [m]
  double least_chord = 2e-3;  ///< of the hand; shorter ones have no direction [m]
};
inline constexpr PlaceWeights kPlaceWeights;

}  // namespace haptrace
