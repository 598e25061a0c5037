// Tests of averaged experts: from recordings to a recording that guidance reads.
#include "player/guidance/averaged_expert.h"

#include "control/path/shapes.h"
#include "control/sample.h"
#include "formats/path/path_changing.h"
#include "formats/path/path_file.h"
#include "player/guidance/guide.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using test::error_of;
using test::TempFolder;
using testing::HasSubstr;

/// Returns a circle whose `number`-th copy is off by a wave of 2 mm, has a force, and rests for a second half way.
Path copy_of_circle(int number, int copies) {
  const Path circle = make_shape("circle", {.duration = 4.0 + 0.3 * number});
  const double phase = 2 * std::numbers::pi * number / copies;
  Path path{.name = fmt::format("copy {}", number)};
  const auto add = [&](double t, std::size_t i) {
    const double u = static_cast<double>(i) / static_cast<double>(circle.size() - 1);
    path.time.push_back(t);
    path.position.emplace_back(circle.position[i] *
                               (1 + 0.05 * std::sqrt(2) * std::sin(2 * std::numbers::pi * u + phase)));
    path.force.emplace_back(0, 0, u);
  };
  const std::size_t half = circle.size() / 2;
  for (std::size_t i = 0; i <= half; ++i) add(circle.time[i], i);
  for (int i = 1; i < 1000; ++i) add(circle.time[half] + 1e-3 * i, half);
  for (std::size_t i = half + 1; i < circle.size(); ++i) add(circle.time[i] + 1, i);
  return path;
}

std::vector<std::shared_ptr<const PathSource>> circles(int copies) {
  std::vector<std::shared_ptr<const PathSource>> sources;
  for (int i = 0; i < copies; ++i) sources.push_back(source_of(copy_of_circle(i, copies)));
  return sources;
}

TEST(AveragedExpert, BecomesARecordingWithItsSpreadItsForceAndItsPauses) {
  const TempFolder folder;
  const std::string file = folder / "expert.h5";
  const AveragedExpert expert = average_experts(circles(6));
  // The radius varies by 2 mm rms, and six evenly spread phases cancel in the mean.
  EXPECT_NEAR(expert.average.overall_spread, 2e-3 * std::sqrt(6.0 / 5), 0.1e-3);
  EXPECT_NEAR(expert.average.directions, 1, 0.01) << "all copies are in one plane";
  EXPECT_NEAR(expert.typical_radius, prediction_factor(6, expert.average.directions) * expert.average.overall_spread,
              1e-9);
  save_average(expert, file, "circle", false, "");
  for (const Finding& finding : check_recording(file)) ADD_FAILURE() << finding.where << ": " << finding.what;
  const Path path = load_path(file);
  EXPECT_NEAR(path.duration(), 4.5, 0.25) << "the median of 4 to 5.5 s, without rest at half way and at the ends";
  for (std::size_t i = 0; i < path.size(); ++i) ASSERT_NEAR(path.position[i].norm(), 0.04, 0.5e-3);
  ASSERT_EQ(path.force.size(), path.size());
  EXPECT_NEAR(path.force[path.size() / 2].z(), 0.5, 0.02);
  const std::vector<StoredEvent> events = RecordingReader(file).events();
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].code, static_cast<std::int32_t>(EventCode::mark));
  EXPECT_THAT(events[0].text, HasSubstr("6 of 6 experts rest here, 1.0 s"));
  EXPECT_NEAR(events[0].time, 0.5 * path.duration(), 0.2);
}

TEST(AveragedExpert, GivesGuidanceItsRadiusAlsoInAnotherPlaceAndSize) {
  const TempFolder folder;
  const std::string file = folder / "expert.h5";
  const AveragedExpert expert = average_experts(circles(6));
  save_average(expert, file, "circle", false, "");
  const test::PointMass device;
  for (const double scale : {1.0, 0.5}) {
    const auto source = changed(open_path(file), Similarity{.scale = scale, .offset = Vec3(0.01, 0, 0)});
    GuideOptions options{.radius = 1e-3, .radius_of_path = true};
    options.radius_profile = averaged_radius(file, source->facts());
    ASSERT_TRUE(options.radius_profile);
    const GuidePlan plan = plan_guidance(device.info(), source, options);
    for (const double share : {0.1, 0.5, 0.9}) {
      const auto row = static_cast<std::size_t>(share * static_cast<double>(expert.average.arc.size() - 1));
      EXPECT_NEAR(plan.path->at(share * plan.path->length()).radius,
                  scale * prediction_factor(6, expert.average.directions) * expert.average.spread[row], 0.2e-3);
    }
  }
}

TEST(AveragedExpert, HasARadiusOnlyIfItIsAnAverage) {
  const TempFolder folder;
  const std::string path = folder / "path.h5", csv = folder / "path.csv";
  save_path(copy_of_circle(0, 6), path, "a path", false);
  save_path(copy_of_circle(0, 6), csv, "a path", false);
  EXPECT_FALSE(averaged_radius(path, open_path(path)->facts()));
  EXPECT_FALSE(averaged_radius(csv, open_path(csv)->facts()));
  EXPECT_THAT(error_of([&] { save_average(average_experts(circles(3)), folder / "a.csv", "", false, ""); }),
              HasSubstr("an average is written as .h5"));
}

TEST(AveragedExpert, HasForcesOnlyIfAllItsRecordingsHaveThem) {
  auto sources = circles(3);
  Path without = copy_of_circle(1, 3);
  without.name = "forceless";
  without.force.clear();
  sources[1] = source_of(without);
  const AveragedExpert expert = average_experts(sources);
  EXPECT_TRUE(expert.path.force.empty());
  EXPECT_THAT(expert.notes, testing::Contains(HasSubstr("forceless has none")));
  EXPECT_THAT(expert.notes, testing::Contains(HasSubstr("the spread of 3 recordings is uncertain")));
}

}  // namespace
}  // namespace haptrace
