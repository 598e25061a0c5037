#include "metrics/reach_blocks.h"

#include "base/json_reader.h"
#include "base/statistics.h"
#include "metrics/recorded_trial.h"

#include <fmt/format.h>
#include <numeric>

namespace haptrace {
namespace {

using Values = std::vector<double>;

std::optional<double> mean_of(const Values& values) {
  if (values.empty()) return std::nullopt;
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

void add_figure(Values& values, const LoggedTrial& trial, const char* name) {
  if (const std::optional<double> value = figure_in(trial.figures, name)) values.push_back(*value);
}

/// Values of one block.
struct BlockValues {
  Values reaction, deviation, after, index;
};

void count_reach(ReachBlockSummary& block, BlockValues& values, const LoggedTrial& trial) {
  // A reach that did not arrive in time has a reaction too, if its cue came.
  if (figure_in(trial.figures, "samples").value_or(0) > 0) {
    if (const std::optional<double> reaction = figure_in(trial.figures, "reaction_time_s"))
      values.reaction.push_back(*reaction);
    else
      ++block.without_reaction;
  }
  if (!trial.finished()) return;
  const ReachKind kind = trial.reach->kind;
  ++(kind == ReachKind::clamp ? block.clamps : kind == ReachKind::catch_trial ? block.catches : block.plain);
  if (const auto share = figure_in(trial.figures, "field_share"); share && *share < ReachFigures::kLeastField) {
    ++block.weakened;
    return;
  }
  add_figure(values.deviation, trial, "lateral_deviation_m");
  add_figure(values.after, trial, "after_effect_m");
  add_figure(values.index, trial, "adaptation_index");
}

}  // namespace

std::vector<ReachBlockSummary> summarise_blocks(const Programme& programme, std::size_t i, const SessionLog& log) {
  std::vector<ReachBlockSummary> blocks;
  if (const auto& task = programme.exercise(i).reach; !task || task->goal != ReachGoal::target) return blocks;
  for (const ReachBlock& block : programme.exercise(i).reach->blocks)
    blocks.push_back({.name = block.name, .field = block.field});
  std::vector<BlockValues> values(blocks.size());
  for (const LoggedTrial& trial : log.trials) {
    if (trial.exercise != i || !trial.reach || !trial.done() || !trial.input.empty() || trial.unattended) continue;
    const auto block = static_cast<std::size_t>(trial.reach->block);
    count_reach(blocks.at(block), values.at(block), trial);
  }
  Values baseline;
  bool before_field = true;
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    ReachBlockSummary& block = blocks[k];
    before_field = before_field && !block.field;
    if (before_field) baseline.insert(baseline.end(), values[k].deviation.begin(), values[k].deviation.end());
    if (!values[k].reaction.empty()) block.reaction_time = median(values[k].reaction);
    block.lateral_deviation = mean_of(values[k].deviation);
    block.after_effect = mean_of(values[k].after);
    block.adaptation_index = mean_of(values[k].index);
    block.refused = block.clamps - values[k].index.size();
    if (block.after_effect && !baseline.empty()) block.after_effect_change = *block.after_effect - *mean_of(baseline);
  }
  return blocks;
}

nlohmann::json to_json(const std::vector<ReachBlockSummary>& blocks) {
  nlohmann::json json = nlohmann::json::array();
  for (const ReachBlockSummary& block : blocks)
    json.push_back({{"name", block.name},
                    {"field", block.field},
                    {"plain", block.plain},
                    {"catches", block.catches},
                    {"clamps", block.clamps},
                    {"clamps_refused", block.refused},
                    {"weakened", block.weakened},
                    {"reaction_time_s", json_of_number(block.reaction_time)},
                    {"without_reaction", block.without_reaction},
                    {"lateral_deviation_m", json_of_number(block.lateral_deviation)},
                    {"after_effect_m", json_of_number(block.after_effect)},
                    {"after_effect_change_m", json_of_number(block.after_effect_change)},
                    {"adaptation_index", json_of_number(block.adaptation_index)}});
  return json;
}

std::string describe(const ReachBlockSummary& block) {
  std::string text = fmt::format("{}: {} finished reaches", block.name.empty() ? "all" : block.name,
                                 block.plain + block.catches + block.clamps);
  const auto add = [&](const char* what, const std::optional<double>& value, double scale, int digits,
                       const char* unit) {
    if (value) text += fmt::format(", {} {:.{}f}{}", what, scale * *value, digits, unit);
  };
  add("median reaction time", block.reaction_time, 1e3, 0, " ms");
  add("lateral deviation", block.lateral_deviation, 1e3, 1, " mm");
  add("after-effect", block.after_effect, 1e3, 1, " mm");
  add("adaptation index", block.adaptation_index, 1, 2, "");
  if (block.weakened > 0)
    text += fmt::format(", {} of {} reaches left out, in which less than {:.0f} % of the field acted", block.weakened,
                        block.plain, 1e2 * ReachFigures::kLeastField);
  if (block.without_reaction > 0)
    text += fmt::format(", {} reaction{} too early, too late or not seen", block.without_reaction,
                        block.without_reaction == 1 ? "" : "s");
  if (block.refused > 0) text += fmt::format(", {} of {} clamps without an index", block.refused, block.clamps);
  return text;
}

}  // namespace haptrace
