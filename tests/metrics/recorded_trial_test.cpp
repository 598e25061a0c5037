// Metrics of trials that are written as recordings and read back.
#include "metrics/recorded_trial.h"

#include "formats/documents/reach_task.h"
#include "tests/report/support.h"
#include "tests/support/errors.h"

#include <algorithm>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using test::error_of;
using test::Hand;
using test::Reference;
using test::rows_of;
using test::TempFolder;
using testing::HasSubstr;

std::vector<RecordedTrial> written(const std::vector<Sample>& rows, Reference reference,
                                   const test::Recorded& recorded = {}) {
  const TempFolder folder;
  const std::string file = folder / "trial.h5";
  test::write(file, rows, reference, recorded);
  return read_trials(RecordingReader(file), file);
}

/// Returns the metrics of a hand relative to the path that it follows.
TrialFigures figures_of(const Hand& hand, Reference reference) {
  const Path path = test::expert_path();
  return trial_figures(written(rows_of(path, hand, reference), reference).back(), path_of(path));
}

std::vector<std::string> undefined(const TrialFigures& figures) {
  std::vector<std::string> names;
  for (const TrialFigure& figure : all_trial_figures())
    if (!figure.value(figures)) names.emplace_back(figure.name);
  return names;
}

TEST(RecordedTrial, HasTheSameMetricsFrom250HzTo4kHz) {
  for (const Reference reference : {Reference::none, Reference::playback, Reference::guidance}) {
    const TrialFigures usual = figures_of({.rate_hz = 1000}, reference);
    for (const double rate : {250.0, 4000.0}) {
      const TrialFigures other = figures_of({.rate_hz = rate}, reference);
      for (const TrialFigure& figure : all_trial_figures()) {
        const std::optional<double> a = figure.value(usual), b = figure.value(other);
        ASSERT_EQ(a.has_value(), b.has_value()) << figure.name << " at " << rate;
        if (!a) continue;
        EXPECT_NEAR(*a, *b, 0.02 * std::abs(*a) + 1e-9) << figure.name << " at " << rate;
      }
    }
  }
}

TEST(RecordedTrial, IsOnThePathWhenTheHandIs) {
  for (const Reference reference : {Reference::none, Reference::playback, Reference::guidance}) {
    const TrialFigures figures = figures_of({.error = 0}, reference);
    EXPECT_LT(figures.contour->peak, 1e-5);
    EXPECT_GT(*figures.completion, 0.99);
    EXPECT_LT(*figures.shape_distance, 5e-4);
    EXPECT_NEAR(*figures.movement->normalised_length, 1, 0.01);
  }
}

TEST(RecordedTrial, MeasuresAKnownDistanceFromThePath) {
  const Path path = test::expert_path();
  std::vector<Sample> rows = rows_of(path, {.error = 0}, Reference::guidance);
  for (Sample& row : rows) row.position.z() += 3e-3;  // the circle lies in xy
  const TrialFigures figures = trial_figures(written(rows, Reference::guidance).back(), path_of(path));
  EXPECT_NEAR(figures.contour->rms, 3e-3, 1e-5);
  EXPECT_NEAR(figures.contour->peak, 3e-3, 1e-5);
  EXPECT_NEAR(*figures.shape_distance, 3e-3, 3e-4);
  EXPECT_EQ(figures.time_in_tunnel, 1);
  for (Sample& row : rows) row.tunnel_radius = 2e-3;
  EXPECT_EQ(trial_figures(written(rows, Reference::guidance).back(), path_of(path)).time_in_tunnel, 0);
}

TEST(RecordedTrial, ComparesTheFeltForceWithTheExpertsAtTheSamePointWhateverTheSpeed) {
  const Path path = test::expert_path();
  for (const double speed : {0.5, 2.0}) {
    std::vector<Sample> rows = rows_of(path, {.error = 0, .speed = speed, .rate_hz = 1000}, Reference::guidance);
    for (Sample& row : rows) row.force = row.reference_force + Vec3(0, 0, 0.25);
    const TrialFigures figures = trial_figures(written(rows, Reference::guidance).back(), path_of(path));
    ASSERT_TRUE(figures.force_error);
    EXPECT_NEAR(figures.force_error->error.rms, 0.25, 0.01) << speed;
    // The expert's force is scaled and signed as in the replay.
    for (Sample& row : rows) row.force = -0.5 * row.reference_force;
    test::Recorded resisting;
    resisting.header.config = {{"force-scale", 0.5}, {"feel", "resist"}};
    EXPECT_LT(trial_figures(written(rows, Reference::guidance, resisting).back(), path_of(path)).force_error->error.rms,
              0.02);
  }
}

TEST(RecordedTrial, MeasuresTheTimeInWhichTheDeviceHelpedAlongThePath) {
  const Path path = test::expert_path();
  std::vector<Sample> rows = rows_of(path, {.error = 0, .rate_hz = 1000}, Reference::guidance);
  const auto helped = [&](double share) {
    double run = 0;
    for (std::size_t i = 1; i + 1 < rows.size(); ++i) {
      Sample& row = rows[i];
      run += row.phase == Phase::run ? 1 : 0;
      const Vec3 along = (rows[i + 1].position - rows[i - 1].position).normalized();
      // Across the path, or against it, is no help.
      row.force = row.reference_force + Vec3(0, 0, 2) - 0.3 * along;
      if (run > (1 - share) * static_cast<double>(rows.size())) row.force += 0.6 * along;
    }
    return trial_figures(written(rows, Reference::guidance).back(), path_of(path)).helped;
  };
  EXPECT_EQ(helped(0), 0);
  EXPECT_NEAR(helped(1).value(), 1, 0.03);
  const double half = helped(0.5).value();
  EXPECT_GT(half, 0.3);
  EXPECT_LT(half, 0.7);
  EXPECT_FALSE(figures_of({}, Reference::playback).helped);
}

TEST(RecordedTrial, LeavesASupportThatRisesAndFadesOutOfTheFieldShare) {
  constexpr double kCue = 1, kReaction = 0.25, kTime = 0.5;  // [s]
  const ReachTrial reach{.geometry = {.target = Vec3(0.1, 0, 0), .lateral = Vec3::UnitY()},
                         .field = curl_field(13, Vec3::UnitZ()),
                         .field_block = true};
  // It acts across the reach, as the field does.
  for (const bool supported : {false, true}) {
    test::Recorded recorded;
    recorded.header.config["reach"] = json_of(reach);
    recorded.supported = supported;
    std::vector<Sample> rows;
    for (std::size_t i = 0; i < 2500; ++i) {
      const double t = 1e-3 * static_cast<double>(i);
      const MinJerk blend = MinJerk::at(std::clamp((t - kCue - kReaction) / kTime, 0.0, 1.0));
      const Vec3 velocity(0.1 * blend.ds / kTime, 0, 0);
      Sample& row = rows.emplace_back();
      row.tick = i;
      row.time_ns = static_cast<std::int64_t>(i) * 1'000'000;
      row.position = Vec3(0.1 * blend.s, 0, 0);
      row.velocity = velocity;
      row.phase = t < kCue ? Phase::approach : Phase::run;
      row.force = reach.field * velocity;
      if (supported) row.force += row.support = std::min(0.5 * t, 1.0) * Vec3(0, 1.5 - row.position.x(), 0);
    }
    const std::vector<RecordedTrial> trials = written(rows, Reference::none, recorded);
    ASSERT_EQ(trials.size(), 1);
    EXPECT_EQ(trials[0].support.size(), supported ? trials[0].time.size() : 0);
    const TrialFigures figures = trial_figures(trials[0], std::nullopt);
    ASSERT_TRUE(figures.reach);
    EXPECT_NEAR(figures.reach->field_share.value_or(-1), 1, 0.01) << supported;
  }
}

TEST(RecordedTrial, AsksForTheEndOfAPathAsTheSessionDoes) {
  const auto completion = [](double diameter) {
    Path path = make_shape("circle", {.size = diameter, .duration = 4});
    std::vector<Sample> rows = rows_of(path, {.error = 0}, Reference::guidance);
    while ((rows.back().position - path.position.back()).norm() < 1.6e-3) rows.pop_back();
    return trial_figures(written(rows, Reference::guidance).back(), path_of(path)).completion.value();
  };
  EXPECT_NEAR(completion(0.08), 1, 1e-3);
  EXPECT_NEAR(completion(0.008), 1 - 1.6e-3 / (std::numbers::pi * 0.008), 0.01)
      << "the last 1.6 mm are not 5 % of this circle";
}

TEST(RecordedTrial, LeavesMetricsWithoutDataUndefined) {
  const Path path = test::expert_path();
  // The hand does not move.
  std::vector<Sample> rows = rows_of(path, {}, Reference::none);
  for (Sample& row : rows) row.position = path.position.front();
  const TrialFigures rest = trial_figures(written(rows, Reference::none).back(), path_of(path));
  EXPECT_FALSE(rest.movement);
  EXPECT_FALSE(rest.shape_distance);
  EXPECT_FALSE(rest.time_in_tunnel);
  EXPECT_NEAR(*rest.completion, 0, 1e-3);
  EXPECT_FALSE(figures_of({}, Reference::none).force_error) << "the expert's forces were not replayed";
  EXPECT_THAT(undefined(rest), testing::IsSupersetOf({"sparc", "movement_time_s", "mean_force_n", "log_jerk"}));
  EXPECT_TRUE(to_json(rest)["sparc"].is_null());

  // There is no path.
  const TrialFigures free =
      trial_figures(written(rows_of(path, {}, Reference::none), Reference::none).back(), std::nullopt);
  EXPECT_TRUE(free.movement->sparc);
  EXPECT_THAT(undefined(free),
              testing::IsSupersetOf({"contour_rms_m", "contour_peak_m", "deviation_rms_m", "completion",
                                     "shape_distance_m", "normalised_length", "force_error_rms_n", "time_in_tunnel"}));

  // An expert without forces, and a trial that ended half-way.
  Path silent = path;
  silent.force.clear();
  EXPECT_FALSE(
      trial_figures(written(rows_of(silent, {}, Reference::guidance), Reference::guidance).back(), path_of(silent))
          .force_error);
  const TrialFigures half = figures_of({.until = 0.5}, Reference::guidance);
  EXPECT_FALSE(half.shape_distance);
  EXPECT_NEAR(*half.completion, 0.5, 0.05);

  // Nothing was recorded.
  EXPECT_TRUE(written({}, Reference::none).empty());
}

TEST(RecordedTrial, DoesNotNormaliseByAPathThatWasHardlyCovered) {
  // A hand rests but trembles across the path, faster than the least speed of a movement.
  const Path path = test::expert_path();
  std::vector<Sample> rows = rows_of(path, {}, Reference::guidance);
  const TrialPath curve = path_of(path);
  const Vec3 start = curve.curve.at(0), across = (curve.curve.at(0.01) - start).cross(Vec3::UnitZ()).normalized();
  for (std::size_t i = 0; i < rows.size(); ++i)
    rows[i].position = start + 1e-3 * std::sin(0.1 * static_cast<double>(i)) * across;
  const TrialFigures rest = trial_figures(written(rows, Reference::guidance).back(), curve);
  ASSERT_TRUE(rest.movement);
  EXPECT_FALSE(rest.movement->normalised_length);
  EXPECT_FALSE(rest.force_error);
  EXPECT_FALSE(rest.shape_distance);
  EXPECT_NEAR(rest.contour->peak, 1e-3, 1e-4) << "the position is known nevertheless";

  // The hand covers 3 % and 10 % of 0.25 m.
  const auto walked = [](const TrialFigures& figures) { return figures.movement->normalised_length.has_value(); };
  const TrialFigures little = figures_of({.error = 0, .until = 0.15}, Reference::guidance);
  EXPECT_FALSE(walked(little) || little.force_error);
  const TrialFigures more = figures_of({.error = 0, .until = 0.25}, Reference::guidance);
  EXPECT_TRUE(walked(more) && more.force_error);

  // 6.6 % of 25 mm are less than 2 mm.
  Path small = path;
  for (Vec3& p : small.position) p *= 0.1;
  EXPECT_FALSE(walked(trial_figures(
      written(rows_of(small, {.error = 0, .until = 0.21}, Reference::guidance), Reference::guidance).back(),
      path_of(small))));
}

TEST(RecordedTrial, DoesNotDependOnTheLivePlaceThatWasRecorded) {
  // The hand turns 8 mm early on a line of 100 mm and back, and the live place waits at the turn.
  Path path;
  for (int i = 0; i <= 4000; ++i) {
    path.time.push_back(1e-3 * i);
    path.position.emplace_back(0.1 * (1 - std::abs(i / 2000.0 - 1)), 0, 0);
  }
  std::vector<Sample> rows;
  for (int i = 0; i <= 4000; ++i) {
    Sample row{.tick = static_cast<std::uint64_t>(i), .time_ns = std::int64_t{i} * 1'000'000, .phase = Phase::run};
    row.position = Vec3(0.092 * (1 - std::abs(i / 2000.0 - 1)), 0, 0);
    row.force = Vec3::Zero();
    row.progress = std::min(0.092, 0.046e-3 * i);
    row.reference_position = Vec3(row.progress, 0, 0);
    row.reference_velocity = Vec3::Zero();
    row.reference_force = Vec3::Zero();
    row.tunnel_radius = 5e-3;
    rows.push_back(row);
  }
  const TrialFigures figures = trial_figures(written(rows, Reference::guidance).back(), path_of(path));
  EXPECT_LT(figures.contour->rms, 0.5e-3) << "it was 47.6 mm";
  EXPECT_EQ(figures.time_in_tunnel, 1);
  EXPECT_GT(*figures.completion, 0.9);
}

TEST(RecordedTrial, HasThePeakForceThatWasSentAlsoOfAHandAtRest) {
  const Path path = test::expert_path();
  std::vector<Sample> rows = rows_of(path, {.rate_hz = 1000}, Reference::guidance);
  for (Sample& row : rows) row.force = Vec3(1, 0, 0);
  for (std::size_t i = 2000; i < 2010; ++i) rows[i].force = Vec3(0, 6, 0);  // for 10 ms
  EXPECT_EQ(trial_figure("peak_force_n").value(trial_figures(written(rows, Reference::guidance).back(), path_of(path))),
            6)
      << "a low pass at 10 Hz leaves less than half";
  for (Sample& row : rows) row.position = path.position.front();
  const TrialFigures rest = trial_figures(written(rows, Reference::guidance).back(), path_of(path));
  EXPECT_FALSE(rest.movement);
  EXPECT_EQ(rest.peak_force, 6);
}

TEST(RecordedTrial, StatesTheDefinitionsOfItsMetrics) {
  const nlohmann::json definitions = definitions_of_figures();
  EXPECT_THAT(definitions["onset_and_end"], HasSubstr("5 %"));
  EXPECT_THAT(definitions["low_pass"], HasSubstr("10 Hz"));
  for (const TrialFigure& figure : all_trial_figures())
    EXPECT_GT(definitions["metrics"][figure.name]["filter"].get<std::string>().size(), 5U) << figure.name;
  EXPECT_THAT(definitions["metrics"]["log_jerk"]["meaning"], HasSubstr("speed form"));
  EXPECT_THAT(definitions["metrics"]["log_jerk_vector"]["meaning"], HasSubstr("vector form"));
  EXPECT_THAT(definitions["metrics"]["peak_force_n"]["filter"], HasSubstr("none"));
  EXPECT_EQ(to_json(figures_of({}, Reference::none))["definitions"], definitions["version"]);
  EXPECT_EQ(to_json(figures_of({}, Reference::none))["samples"], 1000);
}

TEST(RecordedTrial, TakesTheTunnelOfACursorRoundTheCursor) {
  const Path path = test::expert_path();
  const TrialPath curve = path_of(path);
  std::vector<Sample> rows = rows_of(path, {.error = 0}, Reference::guidance);
  for (Sample& row : rows) row.reference_position = curve.curve.at(std::min(row.progress + 0.02, curve.curve.length()));
  test::Recorded recorded;
  recorded.header.config = {{"mode", "cursor"}};
  const TrialFigures late = trial_figures(written(rows, Reference::guidance, recorded).back(), curve);
  EXPECT_LT(late.contour->peak, 1e-5) << "it is on the path all the time";
  EXPECT_LT(*late.time_in_tunnel, 0.2) << "20 mm behind the cursor, of 5 mm";
  const std::string meaning = trial_figure("time_in_tunnel").meaning;
  EXPECT_THAT(meaning, testing::AllOf(HasSubstr("its nearest point on the path"), HasSubstr("cursor")));
}

TEST(RecordedTrial, DescribesThatTheForceThatLeadsToTheStartCounts) {
  EXPECT_THAT(trial_figure("mean_force_n").meaning, testing::AllOf(HasSubstr("0.3 s"), HasSubstr("free")));
}

TEST(RecordedTrial, LeavesTheCompletionUndefinedWhenTheEndOfThePathIsUnknown) {
  const Path path = test::expert_path();
  for (const Reference reference : {Reference::playback, Reference::guidance}) {
    const RecordedTrial trial = written(rows_of(path, {.until = 0.5}, reference), reference).back();
    const std::optional<TrialPath> own = path_of(trial);
    ASSERT_TRUE(own);
    EXPECT_NEAR(own->curve.length(), 0.5 * path_of(path).curve.length(), 2e-3);
    const TrialFigures figures = trial_figures(trial, own);
    EXPECT_FALSE(figures.completion);
    EXPECT_FALSE(figures.shape_distance);
    EXPECT_TRUE(figures.contour);
  }
  EXPECT_FALSE(path_of(written(rows_of(path, {}, Reference::none), Reference::none).back()));
}

TEST(RecordedTrial, KeepsForcesAtTheirPointsOnItsOwnPath) {
  const Path path = test::expert_path();
  std::vector<Sample> rows = rows_of(path, {.error = 0, .rate_hz = 1000}, Reference::guidance);
  // The trainee starts 20 mm along the path and goes back once.
  std::erase_if(rows, [](const Sample& row) { return row.phase == Phase::run && row.progress < 0.02; });
  const std::vector<Sample> whole = rows;
  for (std::size_t i = whole.size(); i-- > whole.size() - 300;) rows.push_back(whole[i]);
  for (std::size_t i = 0; i < rows.size(); ++i)
    rows[i].tick = i, rows[i].time_ns = static_cast<std::int64_t>(i) * 1'000'000;
  const std::optional<TrialPath> own = path_of(written(rows, Reference::guidance).back());
  ASSERT_TRUE(own);
  const TrialPath full = path_of(path);
  EXPECT_NEAR(own->curve.length(), full.curve.length() - 0.02, 1e-3);
  ASSERT_EQ(own->expert.empty(), false);
  for (std::size_t i = 5; i < own->expert.size() - 5; ++i)
    EXPECT_LT((own->expert[i] - full.expert[i + 20]).norm(), 0.05) << i;
}

TEST(RecordedTrial, StaysOnItsBranchWhereAPathCrossesOrRetracesItself) {
  for (const char* kind : {"eight", "stroke"}) {
    Path path;
    for (int i = 0; i <= 4000; ++i) {
      const double s = MinJerk::at(i / 4000.0).s;
      path.time.push_back(1e-3 * i);
      path.position.push_back(kind == std::string_view("eight") ? Vec3(0.04 * std::sin(2 * std::numbers::pi * s),
                                                                       0.04 * std::sin(4 * std::numbers::pi * s), 0)
                                                                : Vec3(0.1 * (1 - std::abs(2 * s - 1)), 0, 0));
    }
    const TrialFigures figures =
        trial_figures(written(rows_of(path, {.error = 0}, Reference::none), Reference::none).back(), path_of(path));
    EXPECT_GT(*figures.completion, 0.99) << kind;
    EXPECT_LT(figures.contour->peak, 1e-4) << kind;
    EXPECT_LT(*figures.shape_distance, 6e-4) << kind;

    // A hand that stops after a third has not completed the path, although the nearest point of the path is never far.
    std::vector<Sample> rows = rows_of(path, {.error = 0, .until = 0.4}, Reference::none);
    EXPECT_LT(*trial_figures(written(rows, Reference::none).back(), path_of(path)).completion, 0.5) << kind;
  }
}

TEST(RecordedTrial, DoesNotTakeATremorForALongMovement) {
  // The position alternates by +-0.05 mm every millisecond for forty seconds: 4 m of travel on 0.25 m of path.
  const Path path = test::expert_path();
  std::vector<Sample> rows = rows_of(path, {.error = 0, .speed = 0.1, .rate_hz = 1000}, Reference::none);
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i].position.z() += i % 2 == 0 ? 5e-5 : -5e-5;
  const TrialFigures figures = trial_figures(written(rows, Reference::none).back(), path_of(path));
  ASSERT_TRUE(figures.shape_distance);
  EXPECT_LT(*figures.shape_distance, 6e-4);
}

TEST(RecordedTrial, IsReadOncePerStretchOfPhaseRun) {
  const Path path = test::expert_path();
  std::vector<Sample> rows = rows_of(path, {}, Reference::playback);
  const std::vector<Sample> more =
      rows_of(path, {.speed = 2}, Reference::playback, rows.back().time_ns + 4'000'000, rows.back().tick + 1);
  rows.insert(rows.end(), more.begin(), more.end());
  const std::vector<RecordedTrial> trials = written(rows, Reference::playback);
  ASSERT_EQ(trials.size(), 2);
  EXPECT_EQ(trials[0].kind, TrialKind::passive);
  EXPECT_EQ(trials[1].repetition, 2);
  EXPECT_NEAR(trials[0].time.back() - trials[0].time.front(), 4, 0.01);
  EXPECT_NEAR(trials[1].time.back() - trials[1].time.front(), 2, 0.01);
  // Without phase run, the whole recording is one trial.
  for (Sample& row : rows) row.phase = Phase::idle;
  EXPECT_EQ(written(rows, Reference::playback).size(), 1);
}

TEST(RecordedTrial, FindsEveryMetricByItsNameAndRejectsOthers) {
  const nlohmann::json json = to_json(figures_of({}, Reference::guidance));
  for (const TrialFigure& figure : all_trial_figures()) {
    EXPECT_TRUE(json.contains(figure.name));
    EXPECT_EQ(&trial_figure(figure.name), &figure);
    EXPECT_GT(std::string(figure.meaning).size(), 20U) << figure.name;
  }
  EXPECT_THAT(error_of([] { (void)trial_figure("contour_rms"); }), HasSubstr("contour_rms_m"));
}

}  // namespace
}  // namespace haptrace
