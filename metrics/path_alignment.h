// Alignment of a whole trial with its path: the place on the path that explains every position, found afterwards.
#pragma once

#include "metrics/polyline.h"

#include <span>
#include <vector>

namespace haptrace {

/// The places of a hand on a path.
struct PathAlignment {
  /// Arc length of the foot point of every row [m]; NaN where the position is not finite.
  std::vector<double> arc;
  /// Rows, in order, before which the place leaves out or repeats a part of the path instead of following it.
  std::vector<std::size_t> jumps;
  double covered = 0;   ///< length of the path that the hand passed, each part once, without the parts left out [m]
  double farthest = 0;  ///< largest arc length of a foot point [m]
};

/// Aligns the positions of a trial with the curve by dynamic programming over arc length, and reads the best sequence
/// of places back from its end. So the place does not depend on the live place in a recording, and a decision
/// that later proves wrong is revised: an early turn on a retraced line, or a shape drawn too small, leaves the hand on
/// its branch.
///
/// States are places s_j on the curve, about u mm apart, where u is the diagonal of the curve's bounding box divided by
/// 110 mm. The hand updates them every u mm of its movement, so time has no weight. A state carries evidence of its
/// position, A_j, which is forgotten, and the cost of its history, B_j, which is kept (lengths in u mm, d_j: distance
/// of the hand, u and t_j: unit chords of hand and path over 6 mm):
///
///     follow   free up to three times as far as the hand moved
///     skip     0.05 per mm forwards          back     0.2 per mm backwards
///     restart  6 at any other place (6.3 behind the best one)
///     observe  B_j += 0.15 dl (1 - u.t_j)    A_j = A_j exp(-dl / 30) + 0.05 dl (sqrt(1 + (d_j / 4)^2) - 1)
///
/// (Viterbi algorithm, as in the map matching of Newson and Krumm 2009; the costs of skips and steps back are linear,
/// so that two sweeps find all of them: Felzenszwalb, Huttenlocher and Kleinberg 2003.) The foot point of a row is the
/// nearest point of the curve within 12 u mm of the best sequence, along the curve.
///
/// Parallel branches in the same direction that are closer than about 15 mm, and identical ones, differ by the history
/// alone: a trial that starts in the middle of such a path may be a branch off.
///
/// At most 2000 states and 3000 updates: O(positions + states * updates) time, 30 ms for the longest on a 2.5 GHz Xeon,
/// and 2 bytes of memory for each state and update. Threads: free function without state. Real-time: no; it allocates.
PathAlignment align_with_path(const Polyline& curve, std::span<const Vec3> position);

}  // namespace haptrace
