#include "studies/trade/tradeoff.h"

#include "base/error.h"
#include "base/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <set>

namespace haptrace {
namespace {

constexpr std::array kInterpolations{Interpolation::hold, Interpolation::linear, Interpolation::cubic,
                                     Interpolation::quintic};
constexpr std::array kEstimators{"difference", "lowpass:50", "lowpass:100",     "lowpass:200",
                                 "foaw:8",     "foaw:15",    "least-squares:8", "alpha-beta-gamma:60"};
constexpr std::array kThinnings{1, 2, 5, 10, 20, 50, 100};
constexpr std::array kSpeeds{0.25, 0.5, 1.0, 2.0, 4.0};
constexpr double kFinestRate = 4000;           // [Hz]
constexpr double kWorth = 0.01;                // share by which a dearer configuration must improve error or ripple
constexpr std::size_t kRefined = 8;            // largest number of combinations that are refined
constexpr const char* kObserver = "observer";  // name of its compensation
constexpr const char* kPlainObserver = "law observer";  // the observer without an LQG law

/// Returns a key that is equal for configurations whose ticks cost the same.
std::string tick_key(const Configuration& c) {
  return fmt::format("{} {} {} {} {}", to_string(c.interpolation), c.velocity, describe(c.with), c.law, c.learn > 0);
}

std::string key_of(const Configuration& c) {
  return fmt::format("{} {} {} {} {}", c.rate_hz, tick_key(c), c.learn, c.thin, c.speed);
}

/// Returns `base` with the PD law alone.
Configuration plain_of(Configuration base) {
  base.with = {};
  base.law.clear();
  base.learn = 0;
  return base;
}

struct LevelOfKnob {
  std::string level;
  Configuration configuration;
};

struct KnobOfPlay {
  std::string name, what;
  std::vector<LevelOfKnob> levels;
};

/// Returns configurations that each leave out one term of `base`.
std::vector<LevelOfKnob> without_each_term(const Configuration& base) {
  std::vector<LevelOfKnob> levels;
  Compensations present = base.with;
  // Learning replaces the model's share of the load.
  if (base.learn > 0) present.gravity = present.friction = false;
  for (const CompensationTerm& term : kCompensationTerms) {
    if (!(present.*term.composed)) continue;
    Configuration configuration = base;
    configuration.with.*term.composed = false;
    if (!configuration.with.observer) configuration.law.clear();
    levels.push_back({term.name, configuration});
  }
  if (base.learn > 0) {
    Configuration configuration = base;
    configuration.learn = 0;
    levels.push_back({"learning", configuration});
  }
  return levels;
}

/// Returns `base` with each of the other laws.
std::vector<LevelOfKnob> laws_of(const Configuration& base) {
  std::vector<LevelOfKnob> levels;
  for (const char* law : kLawNames) {
    if (law == base.law) continue;
    levels.push_back({law, base});
    levels.back().configuration.law = law;
  }
  return levels;
}

/// Returns a setting that takes a member of the base through its levels.
template <class Value, class Levels, class Text>
KnobOfPlay knob(const char* name, const char* what, const Configuration& base, Value Configuration::*member,
                const Levels& levels, const Text& text) {
  KnobOfPlay knob{.name = name, .what = what, .levels = {}};
  for (const auto& level : levels) {
    Configuration configuration = base;
    configuration.*member = level;
    knob.levels.push_back({text(configuration.*member), configuration});
  }
  return knob;
}

std::vector<KnobOfPlay> knobs_of_play(const Workbench& bench, const TradeOptions& options) {
  const Configuration& base = options.base;
  const auto number = [](auto value) { return fmt::format("{:g}", static_cast<double>(value)); };
  std::vector<KnobOfPlay> knobs;
  knobs.push_back(knob("rate", "servo rate [Hz]", base, &Configuration::rate_hz, options.rates, number));
  knobs.push_back(knob("interpolation", "interpolation between the samples of the path", base,
                       &Configuration::interpolation, kInterpolations, [](Interpolation i) { return to_string(i); }));
  knobs.push_back(knob("velocity", "velocity estimator", base, &Configuration::velocity, kEstimators,
                       [](const std::string& v) { return v; }));
  if (bench.calibrated()) {
    KnobOfPlay without{.name = "without", .what = "one compensation left out", .levels = without_each_term(base)};
    without.levels.insert(without.levels.begin(), {"nothing", base});
    const Configuration plain = plain_of(base);
    without.levels.push_back({"all", plain});
    knobs.push_back(without);
    // The observer replaces the velocity estimator. Only without it does the estimator matter.
    if (base.with.observer) {
      knobs.push_back(knob("velocity of PD", "velocity estimator without any compensation", plain,
                           &Configuration::velocity, kEstimators, [](const std::string& v) { return v; }));
    }
    if (base.with.observer && bench.has_laws(base.rate_hz)) {
      KnobOfPlay laws{.name = "law", .what = "control law with the observer, or LQG law by firmness", .levels = {}};
      laws.levels = laws_of(base);
      laws.levels.insert(laws.levels.begin(), {base.law.empty() ? "as play chooses" : base.law, base});
      knobs.push_back(laws);
    }
    std::set<int> lessons{0, 2, 5};
    lessons.insert(base.learn);
    knobs.push_back(knob("learn", "number of repetitions to learn from", base, &Configuration::learn, lessons, number));
  }
  std::vector<int> thinnings;
  for (const int every : kThinnings)
    if (bench.rows() / static_cast<std::uint64_t>(every) >= 4) thinnings.push_back(every);
  knobs.push_back(knob("thin", "every N-th sample of the path is kept", base, &Configuration::thin, thinnings, number));
  std::set<double> speeds(kSpeeds.begin(), kSpeeds.end());
  speeds.insert(base.speed);
  knobs.push_back(knob("speed", "playback speed relative to the path", base, &Configuration::speed, speeds, number));
  return knobs;
}

/// Outcomes by configuration. Repeats no trial.
class Trials {
 public:
  Trials(const Workbench& bench, std::size_t threads, const StopRequest& stop)
      : bench_(bench), threads_(threads), stop_(stop) {}

  /// Tries the configurations that lack `runs` runs. Returns false if it was stopped.
  bool run(const std::vector<Configuration>& configurations, std::size_t runs,
           const std::function<void(double)>& told) {
    std::vector<Configuration> open;
    std::set<std::string> seen;
    for (const Configuration& configuration : configurations) {
      const std::string key = key_of(configuration);
      const auto found = outcomes_.find(key);
      if (found != outcomes_.end() && (found->second.runs >= runs || !found->second.ran())) continue;
      if (seen.insert(key).second) open.push_back(configuration);
    }
    std::vector<Outcome> outcomes(open.size());
    const bool done = run_parallel(
        open.size(), threads_, stop_, [&](std::size_t i) { outcomes[i] = bench_.judge(open[i], runs); },
        [&](std::size_t n) {
          if (told && !open.empty()) told(static_cast<double>(n) / static_cast<double>(open.size()));
        });
    for (Outcome& outcome : outcomes) {
      if (outcome.runs == 0 && outcome.refused.empty()) continue;  // stopped before this one
      const std::string key = key_of(outcome.configuration);
      if (const auto found = outcomes_.find(key); found == outcomes_.end()) order_.push_back(key);
      outcomes_[key] = std::move(outcome);
    }
    return done;
  }

  [[nodiscard]] Outcome* find(const Configuration& configuration) {
    const auto found = outcomes_.find(key_of(configuration));
    return found != outcomes_.end() ? &found->second : nullptr;
  }
  [[nodiscard]] std::vector<Outcome> all() const {
    std::vector<Outcome> all;
    for (const std::string& key : order_) all.push_back(outcomes_.at(key));
    return all;
  }
  template <class Change>
  void each(const Change& change) {
    for (const std::string& key : order_) change(outcomes_.at(key));
  }

 private:
  const Workbench& bench_;
  std::size_t threads_;
  const StopRequest& stop_;
  std::map<std::string, Outcome> outcomes_;
  std::vector<std::string> order_;
};

/// Cost of a tick: that of the base plus that of each choice. The costs add up because each choice is a term of its own
/// or replaces another. In instructions, or in nanoseconds if they cannot be counted.
class TickPrices {
 public:
  TickPrices(const Workbench& bench, const TradeOptions& options, const StopRequest& stop,
             const std::function<void(double)>& told)
      : bench_(bench) {
    base_.rate_hz = options.base.rate_hz;
    counted_ = options.instructions;
    if (counted_) {
      total_ = price_of(base_);
      counted_ = std::isfinite(total_);
    }
    if (!counted_) time_base();
    std::vector<std::pair<std::string, Configuration>> changed;
    const auto add = [&](const std::string& name, const auto& change) {
      Configuration configuration = base_;
      change(configuration);
      changed.emplace_back(name, configuration);
    };
    for (const Interpolation interpolation : kInterpolations)
      add(to_string(interpolation), [&](Configuration& c) { c.interpolation = interpolation; });
    for (const char* velocity : kEstimators) add(velocity, [&](Configuration& c) { c.velocity = velocity; });
    const std::string& velocity = options.base.velocity;
    if (std::find(kEstimators.begin(), kEstimators.end(), velocity) == kEstimators.end())
      add(velocity, [&](Configuration& c) { c.velocity = velocity; });
    if (bench.calibrated()) {
      for (const CompensationTerm& term : kCompensationTerms)
        if (term.composed != &Compensations::learning && term.composed != &Compensations::cogging)
          add(term.name, [&](Configuration& c) { c.with.*term.composed = true; });
      add("learning", [](Configuration& c) { c.learn = 1; });
      if (bench.has_laws(base_.rate_hz))
        add(kPlainObserver, [](Configuration& c) {
          c.with.observer = true;
          c.law = to_string(TrackingLaw::observer);
        });
    }
    for (std::size_t i = 0; i < changed.size() && stop.count() == 0; ++i) {
      const auto& [name, configuration] = changed[i];
      added_[name] = configuration == base_ ? 0 : difference_to(configuration);
      told(static_cast<double>(i + 1) / static_cast<double>(changed.size()));
    }
  }

  void put_on(Outcome& outcome) const {
    const Configuration& c = outcome.configuration;
    double sum = total_ + added(to_string(c.interpolation)) + added(c.velocity);
    Compensations with = c.with;
    with.learning = c.learn > 0;
    if (with.learning) with.gravity = with.friction = false;
    const bool plain_observer = c.law == to_string(TrackingLaw::observer) && added_.contains(kPlainObserver);
    for (const std::string& name : names_of(with))
      sum += added(name == kObserver && plain_observer ? kPlainObserver : name);
    // A sum of differences of times can be less than any tick takes.
    outcome.price = counted_ ? sum : std::max(sum, least_);
    if (counted_) outcome.instructions = sum;
  }

 private:
  /// Times the base several times: their median, and their spread, below which a difference is noise.
  void time_base() {
    std::array<double, 5> times{};
    for (double& time : times) time = price_of(base_);
    std::sort(times.begin(), times.end());
    least_ = times.front();
    total_ = times[times.size() / 2];
    noise_ = times.back() - times.front();
  }
  [[nodiscard]] double difference_to(const Configuration& configuration) {
    const double price = price_of(configuration);
    if (!counted_) least_ = std::min(least_, price);
    const double difference = price - total_;
    return std::abs(difference) <= noise_ ? 0 : difference;
  }
  [[nodiscard]] double price_of(const Configuration& configuration) const {
    if (counted_) return bench_.count_ticks(configuration);
    Outcome outcome{.configuration = configuration, .runs = 1};
    bench_.time_ticks(outcome);
    return 1e9 * outcome.control;
  }
  [[nodiscard]] double added(const std::string& name) const {
    const auto found = added_.find(name);
    return found != added_.end() ? found->second : kNaN;
  }

  const Workbench& bench_;
  Configuration base_;
  bool counted_ = false;
  double total_ = kNaN;
  double noise_ = 0;  ///< of a difference of two times [ns]
  double least_ = 0;  ///< shortest tick that was timed [ns]
  std::map<std::string, double> added_;
};

/// Returns the combinations of servo rates, compensations and learning.
std::vector<Configuration> combinations(const Workbench& bench, const TradeOptions& options) {
  std::vector<Configuration> all;
  for (const double rate : options.rates) {
    Configuration configuration = options.base;
    configuration.rate_hz = rate;
    if (!bench.calibrated()) {
      all.push_back(configuration);
      continue;
    }
    for (unsigned terms = 0; terms < 16; ++terms) {
      configuration.with = {.inertia = (terms & 1) != 0,
                            .gravity = (terms & 2) != 0,
                            .friction = (terms & 4) != 0,
                            .observer = (terms & 8) != 0};
      configuration.learn = 0;
      all.push_back(configuration);
      if (options.base.learn == 0 || configuration.with.gravity || configuration.with.friction) continue;
      configuration.learn = options.base.learn;
      // Gravity and friction are absent when the load is learned.
      all.push_back(configuration);
    }
  }
  return all;
}

/// Returns true when `b` is at least as good as `a` in everything and better in something.
bool beats(const Outcome& b, const Outcome& a) {
  const std::array better{b.error.mean - a.error.mean, b.ripple.mean - a.ripple.mean, b.load() - a.load(),
                          static_cast<double>(b.configuration.learn - a.configuration.learn)};
  return std::all_of(better.begin(), better.end(), [](double d) { return d <= 0; }) &&
         std::any_of(better.begin(), better.end(), [](double d) { return d < 0; });
}

/// Returns the Pareto front, ascending in load. A configuration must improve error or ripple by kWorth over every
/// cheaper one with at most as many repetitions.
std::vector<Outcome> front_of(const std::vector<Outcome>& all, double speed) {
  std::vector<Outcome> ran;
  for (const Outcome& outcome : all)
    if (outcome.ran() && outcome.configuration.speed == speed && std::isfinite(outcome.load())) ran.push_back(outcome);
  std::stable_sort(ran.begin(), ran.end(), [](const Outcome& a, const Outcome& b) {
    return std::tuple(a.load(), a.error.mean) < std::tuple(b.load(), b.error.mean);
  });
  std::vector<Outcome> front;
  for (const Outcome& outcome : ran) {
    if (std::any_of(ran.begin(), ran.end(), [&](const Outcome& other) { return beats(other, outcome); })) continue;
    const bool worth = std::all_of(front.begin(), front.end(), [&](const Outcome& cheaper) {
      return cheaper.configuration.learn > outcome.configuration.learn ||
             outcome.error.mean < (1 - kWorth) * cheaper.error.mean ||
             outcome.ripple.mean < (1 - kWorth) * cheaper.ripple.mean;
    });
    if (worth) front.push_back(outcome);
  }
  return front;
}

/// Returns true when the intervals of error and ripple are narrow enough.
bool interval_known(const Outcome& outcome, double model_error) {
  const double most = std::hypot(kKnownInterval, model_error);
  return outcome.error.half_width <= most * outcome.error.mean &&
         outcome.ripple.half_width <= most * outcome.ripple.mean;
}

/// Returns variants of `base` in settings that have little effect on the cost, one at a time.
std::vector<Configuration> refinements(const Configuration& base, const Workbench& bench) {
  std::vector<Configuration> all;
  for (const Interpolation interpolation : kInterpolations) {
    all.push_back(base);
    all.back().interpolation = interpolation;
  }
  for (const char* velocity : kEstimators) {
    all.push_back(base);
    all.back().velocity = velocity;
  }
  // The cheapest of both together: if neither has an effect by itself, both together have none.
  for (const Interpolation interpolation : {Interpolation::hold, Interpolation::linear}) {
    all.push_back(base);
    all.back().interpolation = interpolation;
    all.back().velocity = "difference";
  }
  if (base.with.observer && bench.has_laws(base.rate_hz))
    for (LevelOfKnob& level : laws_of(base)) all.push_back(std::move(level.configuration));
  for (const int every : {10, 50}) {
    if (bench.rows() / static_cast<std::uint64_t>(every) < 4) continue;
    all.push_back(base);
    all.back().thin = every;
  }
  return all;
}

/// The measurement of a report, stage by stage.
class TradeMeasurement {
 public:
  TradeMeasurement(Workbench& bench, const TradeOptions& options, const StopRequest& stop,
                   const TradeProgress& progress)
      : bench_(bench),
        options_(options),
        stop_(stop),
        progress_(progress),
        varies_(bench.place().varies),
        least_runs_(varies_ ? std::max(options.runs * kFrontRuns, kLeastRuns) : 1),
        trials_(bench, options.threads, stop),
        report_{.options = options,
                .device = bench.device().name,
                .path = bench.place().path->facts().name,
                .path_duration = bench.duration(),
                .calibrated = bench.calibrated()} {}

  TradeReport run(const std::function<void(const TradeReport&)>& draw) {
    bench_.measure_forces_against(finest(), least_runs_, stop_);
    knobs_ = knobs_of_play(bench_, options_);
    const std::vector<Configuration> swept = vary_every_setting();
    time_ticks(swept, stage("timing ticks", 0.12, 0.16));
    // Until the parts of a tick have prices, the load is the time of the whole tick.
    trials_.each([](Outcome& outcome) { outcome.price = 1e9 * outcome.control; });
    gather_sweeps();
    gather_front();
    if (draw) draw(report_);

    find_margins(swept, stage("finding margins", 0.16, 0.2));
    const TickPrices prices(bench_, options_, stop_, stage("measuring the cost of each part of a tick", 0.2, 0.4));
    price_all(prices);
    gather_sweeps();
    if (options_.search && stop_.count() == 0) search(prices);
    gather_front();
    if (options_.search && report_.complete) keep_believed_on_front();
    gather_plain();
    report_.complete = report_.complete && stop_.count() == 0;
    return std::move(report_);
  }

 private:
  /// Returns the progress of a stage that takes the whole from one share to another.
  [[nodiscard]] std::function<void(double)> stage(const char* name, double from, double to) const {
    return [this, name, from, to](double done) {
      if (progress_) progress_(name, from + done * (to - from));
    };
  }

  /// Returns the configuration against which forces are measured.
  [[nodiscard]] Configuration finest() const {
    Configuration finest = options_.base;
    finest.interpolation = Interpolation::quintic;
    finest.thin = 1;
    if (bench_.profile_at(kFinestRate) || !bench_.calibrated()) finest.rate_hz = std::max(kFinestRate, finest.rate_hz);
    return finest;
  }

  /// Tries the base and every level of every setting. Returns these configurations.
  std::vector<Configuration> vary_every_setting() {
    std::vector<Configuration> swept{options_.base};
    for (const KnobOfPlay& knob : knobs_)
      for (const LevelOfKnob& level : knob.levels) swept.push_back(level.configuration);
    report_.complete = trials_.run(swept, options_.runs, stage("varying every setting", 0.02, 0.12));
    return swept;
  }

  /// Returns the outcomes that ran and lack a figure.
  [[nodiscard]] std::vector<Outcome*> without_a(const std::vector<Configuration>& configurations,
                                                double Outcome::*figure) {
    std::vector<Outcome*> open;
    for (const Configuration& configuration : configurations)
      if (Outcome* outcome = trials_.find(configuration);
          outcome != nullptr && outcome->ran() && !std::isfinite(outcome->*figure))
        if (std::find(open.begin(), open.end(), outcome) == open.end()) open.push_back(outcome);
    return open;
  }

  /// Times ticks on one core while the others are idle.
  void time_ticks(const std::vector<Configuration>& configurations, const std::function<void(double)>& told) {
    const std::vector<Outcome*> open = without_a(configurations, &Outcome::control);
    for (std::size_t i = 0; i < open.size() && stop_.count() == 0; ++i) {
      bench_.time_ticks(*open[i]);
      told(static_cast<double>(i + 1) / static_cast<double>(open.size()));
    }
  }

  void find_margins(const std::vector<Configuration>& configurations, const std::function<void(double)>& told) {
    const std::vector<Outcome*> open = without_a(configurations, &Outcome::margin);
    (void)run_parallel(
        open.size(), options_.threads, stop_, [&](std::size_t i) { bench_.find_margin(*open[i]); },
        [&](std::size_t n) {
          if (!open.empty()) told(static_cast<double>(n) / static_cast<double>(open.size()));
        });
  }

  void price_all(const TickPrices& prices) {
    trials_.each([&](Outcome& outcome) { prices.put_on(outcome); });
  }

  /// Tries combinations, refines the best of them, and repeats those on the front until they are known well enough.
  void search(const TickPrices& prices) {
    report_.complete =
        trials_.run(combinations(bench_, options_), options_.runs, stage("trying combinations", 0.4, 0.75));
    price_all(prices);
    refine_best();
    price_all(prices);
    std::vector<Configuration> on_front;
    for (const Outcome& outcome : present_front()) on_front.push_back(outcome.configuration);
    on_front.push_back(plain_of(options_.base));  // its ripple may become a bound, which it keeps by definition
    repeat_uncertain(on_front);
    price_all(prices);
    time_ticks(on_front, stage("timing the best", 0.96, 0.98));
    find_margins(on_front, stage("finding the margins of the best", 0.98, 1));
  }

  void refine_best() {
    const std::vector<Outcome> best = present_front();
    std::vector<Configuration> finer;
    // The choices are spread over the front, from its cheapest to its most accurate end.
    for (std::size_t i = 0; i < std::min(best.size(), kRefined); ++i) {
      const std::size_t at = best.size() <= kRefined ? i : i * (best.size() - 1) / (kRefined - 1);
      for (const Configuration& configuration : refinements(best[at].configuration, bench_))
        finer.push_back(configuration);
    }
    report_.complete = trials_.run(finer, options_.runs, stage("refining the best", 0.75, 0.88)) && report_.complete;
  }

  void repeat_uncertain(std::vector<Configuration> unsure) {
    for (std::size_t times = 1; times <= kMostRepeats && !unsure.empty() && stop_.count() == 0; times *= 2) {
      report_.complete = trials_.run(unsure, times * least_runs_, stage("repeating the uncertain runs", 0.88, 0.96)) &&
                         report_.complete;
      std::erase_if(unsure, [&](const Configuration& configuration) {
        const Outcome* outcome = trials_.find(configuration);
        return outcome == nullptr || !outcome->ran() || !varies_ ||
               interval_known(*outcome, bench_.place().model_error);
      });
    }
  }

  /// Reports the levels of a setting as measured together, with the same number of runs.
  void gather_sweeps() {
    report_.sweeps.clear();
    for (const KnobOfPlay& knob : knobs_) {
      KnobSweep sweep{.knob = knob.name, .what = knob.what, .levels = {}};
      for (const LevelOfKnob& level : knob.levels)
        if (const Outcome* outcome = trials_.find(level.configuration))
          sweep.levels.push_back({level.level, level.configuration == options_.base, *outcome});
      report_.sweeps.push_back(std::move(sweep));
    }
    if (const Outcome* base = trials_.find(options_.base)) report_.base = *base;
    gather_plain();
  }

  void gather_plain() {
    if (const Outcome* plain = trials_.find(plain_of(options_.base)); plain != nullptr && plain->ran())
      report_.plain = *plain;
  }

  [[nodiscard]] std::vector<Outcome> present_front() const { return front_of(trials_.all(), options_.base.speed); }

  void gather_front() {
    report_.tried = trials_.all();
    report_.front = front_of(report_.tried, options_.base.speed);
  }

  /// Keeps only configurations with enough runs on the final front: a single lucky run must not displace a well-known
  /// one.
  void keep_believed_on_front() {
    std::vector<Outcome> believed = report_.tried;
    std::erase_if(believed, [&](const Outcome& outcome) { return outcome.runs < least_runs_; });
    report_.front = front_of(believed, options_.base.speed);
  }

  Workbench& bench_;
  const TradeOptions& options_;
  const StopRequest& stop_;
  const TradeProgress& progress_;
  bool varies_;             ///< runs of the same configuration differ
  std::size_t least_runs_;  ///< of a configuration on the front
  Trials trials_;
  std::vector<KnobOfPlay> knobs_;
  TradeReport report_;
};

}  // namespace

TradeReport measure_trade(Workbench& bench, const TradeOptions& options, const StopRequest& stop,
                          const TradeProgress& progress, const std::function<void(const TradeReport&)>& draw) {
  return TradeMeasurement(bench, options, stop, progress).run(draw);
}

namespace {

/// Chooses from `front`. `exactly`: the most accurate configuration that keeps the budget; else the cheapest.
Choice choose_from(const std::vector<Outcome>& front, const Budget& budget, bool exactly) {
  std::size_t chosen = front.size();
  for (std::size_t i = 0; i < front.size(); ++i) {
    if (!budget.kept(front[i])) continue;
    if (chosen == front.size() || (exactly && front[i].error.mean < front[chosen].error.mean)) chosen = i;
  }
  Choice choice{.kept = chosen < front.size()};
  if (!choice.kept) {
    chosen = 0;
    const auto exceeds = [&](std::size_t i) { return budget.tightest(front[i])->ratio; };
    for (std::size_t i = 1; i < front.size(); ++i)
      if (exceeds(i) < exceeds(chosen)) chosen = i;
  }
  choice.outcome = front[chosen];
  if (chosen > 0) choice.cheaper = front[chosen - 1];
  if (chosen + 1 < front.size()) choice.dearer = front[chosen + 1];
  const auto tightest = *budget.tightest(choice.outcome);
  choice.binding = to_string(*tightest.bound);
  choice.binding_ratio = tightest.ratio;
  const std::optional<Outcome>& next = exactly ? choice.dearer : choice.cheaper;
  if (choice.kept && next && !budget.kept(*next)) choice.excludes = to_string(*budget.tightest(*next)->bound);
  return choice;
}

const SideTrade* storage_of(const TradeReport& report) {
  const auto found = std::find_if(report.sides.begin(), report.sides.end(),
                                  [](const SideTrade& side) { return side.knob == kStorageKnob; });
  return found != report.sides.end() ? &*found : nullptr;
}

/// Scales the size of a recording with the servo rate, because every tick stores a sample [bytes/h].
double bytes_of(const SideTrade::Level& stored, const Outcome& outcome, const TradeReport& report) {
  if (!stored.refused.empty()) return kNaN;
  return stored.values.front() * outcome.configuration.rate_hz / report.base.configuration.rate_hz;
}

}  // namespace

void weigh_recordings(TradeReport& report) {
  const SideTrade* storage = storage_of(report);
  if (storage == nullptr) return;
  const auto weigh_one = [&](Outcome& outcome) {
    outcome.bytes_per_hour = bytes_of(storage->levels.front(), outcome, report);
  };
  for (KnobSweep& sweep : report.sweeps)
    for (KnobLevel& level : sweep.levels) weigh_one(level.outcome);
  for (Outcome& outcome : report.tried) weigh_one(outcome);
  for (Outcome& outcome : report.front) weigh_one(outcome);
  weigh_one(report.base);
  if (report.plain) weigh_one(*report.plain);
}

namespace {

/// Returns the bounds that every choice must keep although `asked` does not name them.
Budget implied_bounds(const TradeReport& report, const Budget& asked) {
  Budget implied;
  if (!asked.limits(Measure::margin)) implied.bounds.push_back({Measure::margin, kLeastMargin});
  if (asked.limits(Measure::ripple) || !report.plain) return implied;
  const double ripple = value_of(*report.plain, Measure::ripple);
  if (std::isfinite(ripple) && ripple > 0) implied.bounds.push_back({Measure::ripple, ripple});
  return implied;
}

std::optional<Choice> choose_within(const TradeReport& report, const Budget& budget, bool exactly) {
  const SideTrade* storage = storage_of(report);
  if (!budget.limits(Measure::bytes) || storage == nullptr) return choose_from(report.front, budget, exactly);
  std::optional<Choice> choice;
  for (std::size_t i = 0; i < storage->levels.size() && !(choice && choice->kept); ++i) {
    if (!storage->levels[i].refused.empty()) continue;
    std::vector<Outcome> front = report.front;
    for (Outcome& outcome : front) outcome.bytes_per_hour = bytes_of(storage->levels[i], outcome, report);
    Choice with = choose_from(front, budget, exactly);
    with.storage = storage_levels()[i];
    // A coarser storage is taken only if it brings the choice nearer to the budget.
    if (!choice || budget.tightest(with.outcome)->ratio < budget.tightest(choice->outcome)->ratio) choice = with;
  }
  return choice;
}

}  // namespace

std::optional<Choice> choose(const TradeReport& report, const Budget& asked) {
  if (!report.complete || report.front.empty()) return std::nullopt;
  const Budget implied = implied_bounds(report, asked);
  Budget budget = asked;
  budget.bounds.insert(budget.bounds.end(), implied.bounds.begin(), implied.bounds.end());
  std::optional<Choice> choice = choose_within(report, budget, !asked.bounds_accuracy());
  if (choice && !choice->kept && report.plain) {
    // A configuration of the same cost but more ripple may have displaced the plain law, whose ripple is the bound.
    TradeReport plain = report;
    plain.front = {*report.plain};
    if (auto kept = choose_within(plain, budget, false); kept->kept) choice = std::move(kept);
  }
  if (choice)
    for (const Bound& bound : implied.bounds) choice->implied.push_back(to_string(bound));
  return choice;
}

void weigh(const Outcome& outcome, const Budget& budget, TermPrice& price) {
  const Outcome& without = price.without;
  price.error_change = without.error.mean - outcome.error.mean;
  price.ripple_change = without.ripple.mean - outcome.ripple.mean;
  price.instructions = outcome.instructions - without.instructions;
  price.control = outcome.control - without.control;
  Budget measured;
  std::copy_if(budget.bounds.begin(), budget.bounds.end(), std::back_inserter(measured.bounds),
               [&](const Bound& bound) { return std::isfinite(mean_of(outcome, bound.measure)); });
  price.dispensable =
      !measured.bounds.empty() && without.ran() && (measured.kept(without) || !measured.kept(outcome)) &&
      std::all_of(measured.bounds.begin(), measured.bounds.end(), [&](const Bound& bound) {
        return std::abs(mean_of(without, bound.measure) - mean_of(outcome, bound.measure)) < bound.limit;
      });
}

Explanation explain(const Workbench& bench, const Configuration& configuration, const Budget& budget,
                    const TradeOptions& options, const StopRequest& stop) {
  const auto measured = [&](const Configuration& one) {
    Outcome outcome = bench.judge(one, options.runs);
    bench.find_margin(outcome);
    bench.time_ticks(outcome);
    if (outcome.ran() && options.instructions) outcome.instructions = bench.count_ticks(one);
    outcome.price = std::isfinite(outcome.instructions) ? outcome.instructions : 1e9 * outcome.control;
    return outcome;
  };
  Explanation explanation{.of = measured(configuration), .terms = {}};
  const Outcome& outcome = explanation.of;
  for (const LevelOfKnob& level : without_each_term(configuration)) {
    if (stop.count() > 0) break;
    TermPrice price{.term = level.level, .without = measured(level.configuration)};
    weigh(outcome, budget, price);
    explanation.terms.push_back(std::move(price));
  }
  return explanation;
}

}  // namespace haptrace
