#include "formats/path/path_stretching.h"

#include "control/path/shapes.h"
#include "tests/formats/support.h"

#include <random>

namespace haptrace {
namespace {

TimeStretch random_stretch(unsigned seed, std::size_t nodes = 50) {
  std::mt19937_64 random(seed);
  std::vector<double> factors(nodes);
  for (double& factor : factors) factor = random() % 3 == 0 ? 1 : std::uniform_real_distribution<double>(1, 10)(random);
  return {0.01, factors};
}

TEST(TimeStretch, LeadsThereAndBackAtEveryTime) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const TimeStretch stretch = random_stretch(seed);
    double before = -1e9;
    for (double t = -0.1; t < 0.7; t += 0.00123) {
      const double later = stretch.later(t);
      EXPECT_GT(later, before);
      before = later;
      EXPECT_NEAR(stretch.before(later), t, 1e-12);
      constexpr double kSmall = 1e-6;
      EXPECT_NEAR((stretch.later(t + kSmall) - stretch.later(t - kSmall)) / (2 * kSmall), stretch.factor(t), 2e-3)
          << "the factor is the slope of the new time";
    }
  }
}

TEST(TimeStretch, NamesThePlacesThatItStretches) {
  const TimeStretch stretch(0.5, {1, 1, 2, 3, 1, 1, 4});
  const auto places = stretch.places();
  ASSERT_EQ(places.size(), 2U);
  EXPECT_EQ(places[0].begin, 0.5);
  EXPECT_EQ(places[0].end, 2);
  EXPECT_EQ(places[0].factor, 3);
  EXPECT_EQ(places[1].begin, 2.5);
  EXPECT_EQ(places[1].end, 3);
  EXPECT_EQ(places[1].factor, 4);
  EXPECT_TRUE(TimeStretch().places().empty());
  EXPECT_TRUE(TimeStretch().is_identity());
  EXPECT_FALSE(stretch.is_identity());
}

TEST(StretchedPath, KeepsPlacesAndDividesVelocitiesByTheFactor) {
  Path circle = make_shape("circle", {.size = 0.1, .duration = 0.5});
  for (double& time : circle.time) time += 3;  // does not start at zero
  const TimeStretch stretch = random_stretch(1);
  const std::shared_ptr<const PathSource> source = source_of(circle);
  const auto slow = stretched(source, stretch);
  const Path rows = slow->read(0, slow->facts().rows);
  ASSERT_EQ(rows.size(), circle.size());
  validate(rows);
  EXPECT_EQ(rows.position, circle.position);
  EXPECT_EQ(rows.time.front(), 3);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_NEAR(rows.time[i], 3 + stretch.later(circle.time[i] - 3), 1e-14);
    EXPECT_LT((rows.velocity[i] * stretch.factor(circle.time[i] - 3) - circle.velocity[i]).norm(), 1e-12);
    EXPECT_EQ(slow->row_at(rows.time[i]), i);
  }
  const auto again = source_of(rows);
  EXPECT_EQ(again->facts().end, slow->facts().end);
  EXPECT_NEAR(again->facts().peak_speed, slow->facts().peak_speed, 1e-12);
  EXPECT_EQ(stretched(source, TimeStretch()), source);
}

}  // namespace
}  // namespace haptrace
