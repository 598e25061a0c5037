#include "control/path/path.h"

#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using testing::HasSubstr;

Path line(std::initializer_list<Vec3> points) {
  Path path;
  path.name = "line.csv";
  for (const Vec3& p : points) {
    path.time.push_back(static_cast<double>(path.time.size()));
    path.position.push_back(p);
  }
  return path;
}

std::string error_of(const Path& path) {
  return test::error_of([&] { validate(path); });
}

const Box kDesk{Vec3::Constant(-0.05), Vec3::Constant(0.05)};

TEST(Path, WithOneSampleIsValid) {
  EXPECT_EQ(error_of(line({Vec3::Zero()})), "no error");
}

TEST(Path, WithoutSamplesIsRefusedByName) {
  EXPECT_THAT(error_of(line({})), HasSubstr("line.csv: the path has no samples"));
}

TEST(Path, RefusesTimeThatDoesNotIncreaseAndNamesTheSample) {
  Path path = line({Vec3::Zero(), Vec3::UnitX(), Vec3::UnitX()});
  path.time[2] = path.time[1];
  EXPECT_THAT(error_of(path), HasSubstr("sample 3"));
  path.time[2] = 0.5;
  EXPECT_THAT(error_of(path), HasSubstr("sample 3"));
  path.time[2] = kNaN;
  EXPECT_THAT(error_of(path), HasSubstr("sample 3: time is not a finite number"));
}

TEST(Path, RefusesValuesThatAreNotFiniteAndNamesTheSample) {
  Path path = line({Vec3::Zero(), Vec3(0, kNaN, 0)});
  EXPECT_THAT(error_of(path), HasSubstr("sample 2: position is not a finite number"));
  path = line({Vec3::Zero(), Vec3::UnitX()});
  path.force = {Vec3::Zero(), Vec3(0, 0, std::numeric_limits<double>::infinity())};
  EXPECT_THAT(error_of(path), HasSubstr("sample 2: force is not a finite number"));
}

TEST(Path, RefusesColumnsOfAnotherLength) {
  Path path = line({Vec3::Zero(), Vec3::UnitX()});
  path.velocity = {Vec3::Zero()};
  EXPECT_THAT(error_of(path), HasSubstr("velocity has 1 samples, but time has 2"));
}

TEST(Path, FourHundredMetresWideIsAUnitMistakeAndTheErrorSaysWhich) {
  EXPECT_THAT(error_of(line({Vec3::Zero(), Vec3(400, 0, 0)})), HasSubstr("these look like millimetres"));
  EXPECT_THAT(error_of(line({Vec3::Zero(), Vec3(4e5, 0, 0)})), HasSubstr("these look like micrometres"));
  EXPECT_EQ(error_of(line({Vec3::Zero(), Vec3(10, 0, 0)})), "no error");
}

TEST(Path, DistanceOutsideIsTheFarthestSampleFromTheBox) {
  EXPECT_EQ(distance_outside(line({Vec3::Zero(), Vec3(0.05, -0.05, 0)}), kDesk), 0);
  EXPECT_NEAR(distance_outside(line({Vec3(0.06, 0, 0), Vec3(0.08, 0.09, 0)}), kDesk), std::hypot(0.03, 0.04), 1e-15);
}

TEST(Path, FitLeavesAPathAloneThatIsInsideTheMargin) {
  const Fit fit = fit_into(line({Vec3::Constant(-0.02), Vec3::Constant(0.03)}), kDesk, 0.1);
  EXPECT_EQ(fit.scale, 1);
  EXPECT_TRUE(fit.offset.isZero(1e-15));
}

TEST(Path, FitMovesNoFartherThanNeeded) {
  const Fit fit = fit_into(line({Vec3(0.5, 0, 0), Vec3(0.52, 0.01, 0)}), kDesk, 0.1);
  EXPECT_EQ(fit.scale, 1);
  EXPECT_NEAR(fit.offset.x(), 0.04 - 0.52, 1e-15);
  EXPECT_NEAR(fit.offset.y(), 0, 1e-15);
}

TEST(Path, FitScalesEveryAxisByTheTightest) {
  Path path = line({Vec3(-0.4, 0, 1), Vec3(0.4, 0.1, 1.02)});
  path.velocity = {Vec3::UnitX(), Vec3::UnitX()};
  const Fit fit = fit_into(path, kDesk, 0.05);
  EXPECT_NEAR(fit.scale, 0.09 / 0.8, 1e-15);
  apply(fit, path);
  EXPECT_LT(distance_outside(path, {Vec3::Constant(-0.045 - 1e-12), Vec3::Constant(0.045 + 1e-12)}), 1e-12);
  EXPECT_NEAR(path.velocity[0].x(), fit.scale, 1e-15);
}

}  // namespace
}  // namespace haptrace
