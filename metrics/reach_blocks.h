// Results of the blocks of a reaching exercise: deviation, after-effect and adaptation.
#pragma once

#include "formats/documents/session_log.h"

#include <cstddef>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Means over the finished reaches of one block; reaction times of all whose cue came. Reaches by a person who steered
/// a simulated hand, and those that were softened because nobody attended, do not count. A mean of nothing is empty.
struct ReachBlockSummary {
  std::string name;
  bool field = false;
  std::size_t plain = 0, catches = 0, clamps = 0;  ///< finished reaches of each kind
  std::size_t refused = 0;                         ///< clamps without an adaptation index
  /// Plain reaches in which less than ReachFigures::kLeastField of the field acted. They do not count in the means.
  std::size_t weakened = 0;
  std::size_t without_reaction = 0;           ///< of all kinds: the reaction was too early, too late or not seen
  std::optional<double> reaction_time;        ///< median over all kinds [s]
  std::optional<double> lateral_deviation;    ///< of plain reaches, at peak speed [m]
  std::optional<double> after_effect;         ///< of catch trials [m]
  std::optional<double> after_effect_change;  ///< less the deviation in the blocks before the first field [m]
  std::optional<double> adaptation_index;     ///< of clamps
};

/// Returns a summary for each block of exercise `i`; none for an exercise in another mode than reach.
std::vector<ReachBlockSummary> summarise_blocks(const Programme& programme, std::size_t i, const SessionLog& log);

nlohmann::json to_json(const std::vector<ReachBlockSummary>& blocks);

/// Returns one line of a block for users, in mm: "field: 17 reaches, deviation -4.1 mm, after-effect 6.2 mm".
std::string describe(const ReachBlockSummary& block);

}  // namespace haptrace
