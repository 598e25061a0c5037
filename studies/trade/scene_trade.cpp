#include "studies/trade/scene_trade.h"

#include "base/error.h"
#include "base/number.h"
#include "base/stopwatch.h"
#include "base/suggest.h"
#include "base/text_file.h"
#include "base/units.h"
#include "scene/scene_file.h"
#include "scene/scene_files.h"
#include "scene/slow_scene.h"
#include "studies/trade/instruction_count.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <limits>
#include <utility>

namespace haptrace {
namespace {

/// A bound of a scene's budget.
struct BoundFacts {
  const char* name;
  const char* si;
  double SceneBudget::*limit;
  double SceneChoice::*value;
  bool accuracy;
};
constexpr std::array kBounds{BoundFacts{"error", "N", &SceneBudget::error, &SceneChoice::error, true},
                             BoundFacts{"peak", "N", &SceneBudget::peak, &SceneChoice::peak, true},
                             BoundFacts{"time", "s", &SceneBudget::time, &SceneChoice::time, false}};

constexpr std::size_t kMostCombinations = 256;
constexpr int kSweeps = 3;

bool bounds_accuracy(const SceneBudget& budget) {
  return std::any_of(kBounds.begin(), kBounds.end(),
                     [&](const BoundFacts& bound) { return bound.accuracy && !std::isnan(budget.*bound.limit); });
}

/// Returns the largest share of a limit that is used; at most 1 if all are kept.
double use_of(const SceneChoice& choice, const SceneBudget& budget) {
  double most = 0;
  for (const BoundFacts& bound : kBounds)
    if (const double limit = budget.*bound.limit; !std::isnan(limit))
      most = std::max(most, choice.*bound.value / limit);
  return most;
}

double cost_of(const SceneChoice& choice) {
  return std::isnan(choice.instructions) ? choice.time : choice.instructions;
}

/// Returns whether `a` is to be preferred to `b`.
bool better(const SceneChoice& a, const SceneChoice& b, const SceneBudget& budget) {
  if (a.kept != b.kept) return a.kept;
  if (!a.kept) return use_of(a, budget) < use_of(b, budget);
  const auto order = [cheapest = bounds_accuracy(budget)](const SceneChoice& choice) {
    return cheapest ? std::pair(cost_of(choice), choice.error) : std::pair(choice.error, cost_of(choice));
  };
  return order(a) < order(b);
}

/// Returns the levels of a setting that are worth trying, from the fastest to the most accurate, its own among them.
std::vector<double> levels_of(const Knob& knob) {
  std::vector<double> levels = knob.levels;
  if (std::find(levels.begin(), levels.end(), knob.level) == levels.end()) levels.push_back(knob.level);
  return levels;
}

/// Names the files of the folder by their whole path, wherever the scene names them.
void name_wholly(nlohmann::json& json, const std::filesystem::path& folder, const std::vector<std::string>& files) {
  if (json.is_structured())
    for (nlohmann::json& part : json) name_wholly(part, folder, files);
  if (!json.is_string()) return;
  const std::filesystem::path path = folder / json.get<std::string>();
  if (std::find(files.begin(), files.end(), path.string()) != files.end())
    json = std::filesystem::absolute(path).lexically_normal().string();
}

/// Returns all parts of an object in which its settings can be.
std::vector<nlohmann::json::json_pointer> parts_of(const nlohmann::json& object) {
  std::vector<nlohmann::json::json_pointer> parts{nlohmann::json::json_pointer()};
  for (const char* part : {"/shape", "/surface", "/surface/texture", "/texture"})
    if (const nlohmann::json::json_pointer at(part); object.contains(at) && object.at(at).is_object())
      parts.push_back(at);
  return parts;
}

/// Sets a setting in the one part of an object that takes it. Returns false if none does.
bool set_in(nlohmann::json& scene, std::size_t object, const std::string& setting, const std::string& key, double level,
            SceneFiles files) {
  const auto takes = [&](const nlohmann::json& changed) {
    try {
      const std::vector<Knob> knobs = read_scene(changed, "scene", files)->knobs();
      return std::any_of(knobs.begin(), knobs.end(),
                         [&](const Knob& knob) { return knob.name == setting && knob.level == level; });
    } catch (const Error&) {
      return false;
    }
  };
  for (const auto& part : parts_of(scene["objects"][object])) {
    nlohmann::json changed = scene;
    nlohmann::json& value = changed["objects"][object].at(part)[key];
    const bool flag = value.is_boolean();
    for (const bool as_flag : {flag, !flag}) {
      value = as_flag ? nlohmann::json(level != 0) : nlohmann::json(level);
      if (!as_flag && level == std::round(level)) value = static_cast<std::int64_t>(level);
      if (!takes(changed)) continue;
      scene = std::move(changed);
      return true;
    }
  }
  return false;
}

}  // namespace

SceneBudget parse_scene_budget(std::string_view text) {
  SceneBudget budget;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t comma = std::min(text.find(',', begin), text.size());
    const std::string part(trim(text.substr(begin, comma - begin)));
    begin = comma + 1;
    const auto wrong = [&](const std::string& why) {
      return input_error(fmt::format("--scene-budget: '{}': {}", part, why));
    };
    const std::size_t sign = part.find("<=");
    if (sign == std::string::npos) throw wrong("a bound is a measure, <=, and a limit, as in error<=20mN");
    const std::string name(trim(std::string_view(part).substr(0, sign)));
    std::vector<std::string> known;
    for (const BoundFacts& bound : kBounds) known.emplace_back(bound.name);
    const auto found = std::find(known.begin(), known.end(), name);
    if (found == known.end()) throw wrong(fmt::format("unknown measure '{}'{}", name, suggestion(name, known)));
    const BoundFacts& bound = kBounds.at(static_cast<std::size_t>(found - known.begin()));
    const std::string_view quantity = trim(std::string_view(part).substr(sign + 2));
    if (number_of<double>(quantity)) throw wrong(fmt::format("write its unit, as in {}<=1{}", name, bound.si));
    const std::optional<double> limit = parse_quantity(quantity, bound.si);
    if (!limit || !(*limit > 0)) throw wrong(fmt::format("its limit must be a positive number [{}]", bound.si));
    budget.*bound.limit = *limit;
  }
  return budget;
}

std::string to_string(const SceneBudget& budget) {
  std::vector<std::string> parts;
  for (const BoundFacts& bound : kBounds) {
    const double limit = budget.*bound.limit;
    if (std::isnan(limit)) continue;
    parts.push_back(bound.accuracy ? fmt::format("{}<={:.4g}N", bound.name, limit)
                                   : fmt::format("{}<={:.4g}ns", bound.name, 1e9 * limit));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

SceneBench::SceneBench(const Workbench& bench, double rate_hz, std::function<std::shared_ptr<Scene>()> load,
                       bool instructions)
    : rate_hz_(rate_hz), load_(std::move(load)), instructions_(instructions) {
  const double period = 1 / rate_hz;
  const Trajectory& path = bench.exact();
  const auto ticks = static_cast<std::size_t>(path.duration() * rate_hz);
  const std::shared_ptr<Scene> exact = load_();
  for (const Knob& knob : exact->knobs()) exact->set(knob.name, knob.name.ends_with(".lead") ? 0 : knob.levels.back());
  exact->prepare({.rate_hz = rate_hz});
  exact->reset();
  Trajectory::Cursor cursor;
  first_touch_ = ticks;
  for (std::size_t i = 0; i < ticks; ++i) {
    const Reference here = path.sample(static_cast<double>(i) * period, cursor);
    const Reference middle = path.sample((static_cast<double>(i) + 0.5) * period, cursor);
    touches_.push_back({here.position, here.velocity, i > 0 ? period : 0});
    const SceneAnswer answer = exact->answer({middle.position, middle.velocity, i > 0 ? period : 0});
    truth_.push_back(answer.force);
    touched_.push_back(std::any_of(answer.contacts.begin(), answer.contacts.end(),
                                   [](const Contact& contact) { return contact.touched(); }));
    if (touched_.back()) first_touch_ = std::min(first_touch_, i);
  }
}

SceneBench::Measured SceneBench::measure(Touchable& scene, bool instructions) const {
  const std::size_t ticks = touches_.size();
  double squares = 0, peak = 0, work = 0, stored = 0, seconds = 0;
  std::size_t count = 0;
  scene.reset();
  SceneAnswer answer;
  for (std::size_t i = 0; i < ticks; ++i) {
    const Stopwatch watch;
    answer = scene.answer(touches_[i]);
    seconds += watch.seconds();
    scene.between_ticks(true);
    if (i == 0) stored = answer.stored;
    if (i + 1 < ticks) work += answer.force.dot(touches_[i + 1].position - touches_[i].position);
    if (!touched_[i]) continue;
    ++count;
    const double off = (answer.force - truth_[i]).norm();
    squares += off * off;
    peak = std::max(peak, off);
  }
  Measured measured{.error = std::sqrt(squares / static_cast<double>(count)),
                    .peak = peak,
                    .created = work + answer.stored - stored,
                    .time = seconds / static_cast<double>(ticks),
                    .instructions = kNaN};
  constexpr std::size_t kCounted = 4;
  if (instructions && first_touch_ + kCounted < ticks) {
    const auto counted = count_instructions([&](const std::function<void()>& mark) {
      mark();
      for (std::size_t i = 0; i < kCounted; ++i) (void)scene.answer(touches_[first_touch_ + i]);
      mark();
    });
    if (!counted.empty()) measured.instructions = static_cast<double>(counted.front()) / kCounted;
  }
  return measured;
}

SideTrade SceneBench::trade() const {
  SideTrade trade{.knob = "scene",
                  .what = "accuracy settings of the scene, and slower rates of the scene, with the tool on the path",
                  .columns = {{"force_error_n", "rms N", 1, 4},
                              {"peak_force_error_n", "peak N", 1, 3},
                              {"energy_created_j", "mJ", 1e-3, 3},
                              {"answer_s", "ns", 1e-9, 0},
                              {"instructions", "instr.", 1, 0}},
                  .levels = {}};
  if (!touches()) return trade;
  const auto add = [&](const std::string& name, bool is_default, Touchable& scene, bool instructions) {
    const Measured m = measure(scene, instructions);
    trade.levels.push_back({.level = name,
                            .is_default = is_default,
                            .values = {m.error, m.peak, m.created, m.time, m.instructions},
                            .refused = {}});
  };
  const std::shared_ptr<Scene> asked = load_();
  asked->prepare({.rate_hz = rate_hz_});
  add("as it is", true, *asked, instructions_);
  for (const Knob& knob : asked->knobs()) {
    for (const double level : knob.levels) {
      const std::shared_ptr<Scene> turned = load_();
      turned->set(knob.name, level);
      turned->prepare({.rate_hz = rate_hz_});
      add(fmt::format("{} {:.10g}{}{}", knob.name, level, knob.unit.empty() ? "" : " ", knob.unit), false, *turned,
          instructions_);
    }
  }
  for (const double share : {0.1, 0.05}) {
    for (const Prediction prediction : {Prediction::hold, Prediction::linear, Prediction::model}) {
      SlowScene slow(load_(), {.rate_hz = share * rate_hz_, .prediction = prediction}, rate_hz_);
      add(fmt::format("at {:g} Hz, {}", share * rate_hz_, to_string(prediction)), false, slow, false);
    }
  }
  return trade;
}

SceneChoice SceneBench::tried(const Levels& levels, const SceneBudget& budget) const {
  auto known = known_.find(levels);
  if (known == known_.end()) {
    const std::shared_ptr<Scene> scene = load_();
    for (const auto& [setting, level] : levels) scene->set(setting, level);
    scene->prepare({.rate_hz = rate_hz_});
    known = known_.emplace(levels, measure(*scene, instructions_)).first;
  }
  const Measured& m = known->second;
  SceneChoice choice{
      .levels = levels, .error = m.error, .peak = m.peak, .time = m.time, .instructions = m.instructions};
  choice.kept = use_of(choice, budget) <= 1;
  return choice;
}

SceneChoice SceneBench::choose(const SceneBudget& budget, const StopRequest& stop) const {
  const std::vector<Knob> knobs = load_()->knobs();
  Levels levels;
  std::size_t combinations = 1;
  for (const Knob& knob : knobs) {
    levels[knob.name] = knob.level;
    combinations = std::min(combinations * levels_of(knob).size(), kMostCombinations + 1);
  }
  SceneChoice best = tried(levels, budget);
  const auto try_out = [&](const Levels& one) {
    if (stop.count() > 0) return;
    if (SceneChoice choice = tried(one, budget); better(choice, best, budget)) best = std::move(choice);
  };
  if (combinations <= kMostCombinations) {
    for (std::size_t i = 0; i < combinations; ++i) {
      std::size_t left = i;
      for (const Knob& knob : knobs) {
        const std::vector<double> all = levels_of(knob);
        levels[knob.name] = all[left % all.size()];
        left /= all.size();
      }
      try_out(levels);
    }
    return best;
  }
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    const Levels before = best.levels;
    for (const Knob& knob : knobs) {
      levels = best.levels;
      for (const double level : levels_of(knob)) {
        levels[knob.name] = level;
        try_out(levels);
      }
    }
    if (best.levels == before) break;
  }
  return best;
}

nlohmann::json scene_with(const nlohmann::json& scene, const std::string& folder,
                          const std::map<std::string, double>& levels) {
  SceneFiles files(folder);
  const std::vector<Knob> knobs = read_scene(scene, "scene", files)->knobs();
  const std::vector<std::string> names = read_scene(scene, "scene", files)->names();
  nlohmann::json changed = scene;
  for (const auto& [name, level] : levels) {
    const std::string& setting = name;
    const auto own = std::find_if(knobs.begin(), knobs.end(), [&](const Knob& knob) { return knob.name == setting; });
    if (own != knobs.end() && own->level == level) continue;
    const std::size_t dot = setting.rfind('.');
    const auto object = std::find(names.begin(), names.end(), setting.substr(0, dot));
    if (object == names.end() || !set_in(changed, static_cast<std::size_t>(object - names.begin()), setting,
                                         setting.substr(dot + 1), level, SceneFiles(folder)))
      throw input_error(fmt::format("the scene has no place for the setting '{}'", setting));
  }
  name_wholly(changed, folder, files.used());
  return changed;
}

nlohmann::json to_json(const SceneChoice& choice) {
  const auto known = [](double value) { return std::isnan(value) ? nlohmann::json() : nlohmann::json(value); };
  return {{"settings", choice.levels},
          {"force_error_n", choice.error},
          {"peak_force_error_n", choice.peak},
          {"answer_s", choice.time},
          {"instructions", known(choice.instructions)},
          {"kept", choice.kept}};
}

std::string text_of(const SceneChoice& choice, const SceneBudget& budget) {
  std::string settings;
  for (const auto& [setting, level] : choice.levels)
    settings += fmt::format("{}{} {:.10g}", settings.empty() ? "" : ", ", setting, level);
  return fmt::format("  scene: {}\n    {} {}: error {:.4f} N rms, {:.3f} N peak, {:.0f} ns an answer\n",
                     settings.empty() ? "it has no accuracy settings" : settings,
                     choice.kept ? "keeps" : "no settings keep", to_string(budget), choice.error, choice.peak,
                     1e9 * choice.time);
}

}  // namespace haptrace
