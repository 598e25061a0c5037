#include "player/programme/progression.h"

#include "base/json_reader.h"
#include "tests/support/errors.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using nlohmann::json;
using test::error_of;
using testing::AllOf;
using testing::HasSubstr;

json figures_of_mm(double mm) {
  return {{"contour_rms_m", 1e-3 * mm}};
}

/// Returns a finished repetition with this error [mm].
LoggedTrial error_of_mm(double mm) {
  return {.stopped_by = "finished", .figures = figures_of_mm(mm)};
}

Exercise assisted(double forget = 0.8, double gain = 0.5) {
  Exercise exercise{.name = "a", .mode = ExerciseMode::assisted};
  exercise.progression =
      Progression{.target = 2e-3, .assistance = Progression::Assistance{.forget = forget, .gain = gain}};
  return exercise;
}

TEST(Progression, RemovesAssistanceThatIsNotNeeded) {
  const Exercise exercise = assisted();
  ProgressionState state(exercise);
  double expected = 1;
  for (int i = 0; i < 30; ++i) {
    EXPECT_NEAR(state.settings().assistance, expected, 1e-12);
    state.learn(error_of_mm(i % 2 == 0 ? 0.1 : 2));  // an error within the target counts as zero
    expected *= 0.8;
  }
  EXPECT_LT(state.settings().assistance, 2e-3);
}

TEST(Progression, FadesFasterThanTheTraineeLearns) {
  // The error falls by a tenth per repetition although the trainee relies on the help; the law still reduces the help.
  const Exercise exercise = assisted(0.8, 0.3);
  ProgressionState state(exercise);
  double mm = 3.5, before = 1;
  int fell = 0;
  for (int i = 0; i < 20; ++i, mm *= 0.9) {
    state.learn(error_of_mm(mm));
    fell += state.settings().assistance < before ? 1 : 0;
    before = state.settings().assistance;
  }
  EXPECT_GE(fell, 18);
  EXPECT_LT(before, 0.05);
}

TEST(Progression, HelpsInProportionToTheShortfall) {
  const Exercise exercise = assisted(0.5, 0.5);
  ProgressionState state(exercise);
  for (int i = 0; i < 40; ++i) state.learn(error_of_mm(3));  // exceeds the target by half
  EXPECT_NEAR(state.settings().assistance, 0.5 * 0.5 / (1 - 0.5), 1e-9) << "where forgetting and error balance";
  for (int i = 0; i < 40; ++i) state.learn(error_of_mm(50));
  EXPECT_NEAR(state.settings().assistance, 1, 1e-9);
  EXPECT_LE(state.settings().assistance, 1) << "never beyond all";
}

TEST(Progression, CountsATrialWithoutAMetricAsFailed) {
  const Exercise exercise = assisted(0.5, 0.5);
  ProgressionState state(exercise);
  for (int i = 0; i < 10; ++i) state.learn(error_of_mm(1));
  state.learn({.stopped_by = "finished", .figures = {{"contour_rms_m", nullptr}}});
  EXPECT_GT(state.settings().assistance, 0.5);
  for (int i = 0; i < 10; ++i) state.learn(error_of_mm(1));
  state.learn({.stopped_by = "time_over", .figures = figures_of_mm(0.1)});
  EXPECT_GT(state.settings().assistance, 0.5) << "a hand that rests on the path has not followed it";
  EXPECT_EQ(shortfall(*exercise.progression, std::nullopt), 1);
}

TEST(Progression, KnowsWhichMetricsAreBetterWhenTheyAreLarger) {
  EXPECT_DOUBLE_EQ(shortfall({.figure = "time_in_tunnel", .target = 0.8}, 0.9), 0);
  EXPECT_DOUBLE_EQ(shortfall({.figure = "time_in_tunnel", .target = 0.8}, 0.6), 0.25);
  EXPECT_DOUBLE_EQ(shortfall({.figure = "movement_time_s", .target = 2}, 1.5), 0);
  EXPECT_DOUBLE_EQ(shortfall({.figure = "movement_time_s", .target = 2}, 2.5), 0.25);
  // SPARC is negative: -1.4 is smooth, -3 is not.
  EXPECT_DOUBLE_EQ(shortfall({.figure = "sparc", .target = -2}, -1.5), 0);
  EXPECT_DOUBLE_EQ(shortfall({.figure = "sparc", .target = -2}, -3), 0.5);
}

Exercise harder() {
  Exercise exercise{.name = "a", .radius = 7e-3};
  exercise.progression = Progression{.target = 2e-3, .tolerance = 0.5, .window = 3};
  exercise.progression->difficulty = Progression::Difficulty{.step = 0.5, .radius = DifficultyRange{8e-3, 2e-3}};
  return exercise;
}

TEST(Progression, BecomesHarderWhenItGoesWellAndEasierWhenItDoesNot) {
  const Exercise exercise = harder();
  ProgressionState state(exercise);
  EXPECT_DOUBLE_EQ(state.settings().radius, 8e-3);
  for (int i = 0; i < 2; ++i) state.learn(error_of_mm(1));
  EXPECT_DOUBLE_EQ(state.settings().radius, 8e-3) << "two repetitions are no window of three";
  state.learn(error_of_mm(1));
  EXPECT_NEAR(state.settings().radius, 4e-3, 1e-12);
  state.learn(error_of_mm(1));
  EXPECT_NEAR(state.settings().radius, 4e-3, 1e-12) << "each level has a window of its own";
  state.learn(error_of_mm(9));  // one bad repetition of three
  state.learn(error_of_mm(1));
  EXPECT_NEAR(state.settings().radius, 2e-3, 1e-12);
  for (int i = 0; i < 9; ++i) state.learn(error_of_mm(1));
  EXPECT_NEAR(state.settings().radius, 2e-3, 1e-12) << "no harder than hard";
  for (int i = 0; i < 9; ++i) state.learn(error_of_mm(2.5));
  EXPECT_NEAR(state.settings().radius, 2e-3, 1e-12) << "between target and tolerance it stays";
  for (int i = 0; i < 60; ++i) state.learn(error_of_mm(9));
  EXPECT_DOUBLE_EQ(state.settings().radius, 8e-3) << "no easier than easy";
}

TEST(Progression, LeavesAnExerciseWithoutProgressionUnchanged) {
  const Exercise exercise{.name = "a", .pace = 0.7, .radius = 3e-3, .stiffness = 120};
  ProgressionState state(exercise);
  for (int i = 0; i < 5; ++i) state.learn(error_of_mm(50));
  const TrialSettings expected{.pace = 0.7, .radius = 3e-3, .stiffness = 120};
  EXPECT_TRUE(state.settings() == expected);
}

TEST(Fatigue, NeedsSeveralRepetitionsWorseThanTheBest) {
  const ProgrammeLimits::Fatigue law{.figure = "contour_rms_m", .worse = 0.5, .repetitions = 3};
  const auto tired = [&](std::initializer_list<double> errors) {
    std::vector<json> figures;
    for (const double mm : errors) figures.push_back(figures_of_mm(mm));
    return is_tired(law, figures);
  };
  EXPECT_FALSE(tired({}));
  EXPECT_FALSE(tired({2, 4, 4})) << "three have nothing before them to be worse than";
  EXPECT_TRUE(tired({2, 4, 4, 4}));
  EXPECT_FALSE(tired({2, 4, 2.5, 4})) << "one of them was good";
  EXPECT_FALSE(tired({2, 2.9, 2.9, 2.9}));
  EXPECT_TRUE(tired({9, 2, 9, 3.1, 3.1, 3.1})) << "worse than the best, not than the first";
  EXPECT_TRUE(is_tired(law, {figures_of_mm(1), json::object(), json::object(), json::object()}))
      << "a participant who no longer moves is tired";
}

TEST(Progression, RejectsUnknownMetricsAndMetricsWithoutADirection) {
  Programme programme{.exercises = {assisted()}};
  EXPECT_NO_THROW(check_figures(programme, "p.json"));
  programme.exercises[0].progression->figure = "contour_rsm_m";
  EXPECT_THAT(error_of([&] { check_figures(programme, "p.json"); }),
              AllOf(HasSubstr("p.json: exercises[0].progression.figure"), HasSubstr("contour_rms_m")));
  programme.exercises[0].progression->figure = "mean_force_n";
  EXPECT_THAT(error_of([&] { check_figures(programme, "p.json"); }), HasSubstr("neither better nor worse"));
  programme = {.exercises = {Exercise{}}};
  programme.limits.fatigue = ProgrammeLimits::Fatigue{.figure = "nothing"};
  EXPECT_THAT(error_of([&] { check_figures(programme, "p.json"); }), HasSubstr("limits.fatigue.figure"));
}

}  // namespace
}  // namespace haptrace
