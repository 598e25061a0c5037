#include "base/vectors.h"

#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <limits>

namespace haptrace {
namespace {

using test::error_of;
using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

TEST(ParseVector, ReadsThreeNumbersWithOrWithoutUnits) {
  EXPECT_EQ(parse_vector("10mm,-2cm,0.5", "m", "it"), Vec3(0.01, -0.02, 0.5));
  for (const char* text : {"", "1,2", "1,2,3,4", "1,,3", "1s,0,0", "nan,0,0", "a,b,c", ",,"})
    EXPECT_THAT(error_of([&] { (void)parse_vector(text, "m", "the offset"); }), StartsWith("the offset is '")) << text;
}

TEST(DirectionOf, IsTheUnitVectorAlongAVectorOfAnyLength) {
  for (const double length : {1e-300, 1e-4, 1.0, 7.0, 1e300})
    EXPECT_LT((direction_of(length * Vec3(1, -2, 2), "it") - Vec3(1, -2, 2) / 3).norm(), 1e-15) << length;
  EXPECT_EQ(direction_of(-0.5 * Vec3::UnitY(), "it"), -Vec3::UnitY());
}

TEST(DirectionOf, RefusesAVectorWithoutALength) {
  for (const Vec3& vector :
       {Vec3(0, 0, 0), Vec3(-0.0, 0, 0), Vec3(1, kNaN, 0), nan3(), Vec3(1, 0, std::numeric_limits<double>::infinity())})
    EXPECT_THAT(error_of([&] { (void)direction_of(vector, "p.json: up"); }),
                AllOf(StartsWith("p.json: up: has no length, so it is no direction"), HasSubstr("give three finite")));
}

TEST(ParseDirection, ReadsThreeNumbersWithoutUnitsAsAUnitVector) {
  EXPECT_EQ(parse_direction("0,0,-3", "--up"), -Vec3::UnitZ());
  EXPECT_LT((parse_direction("1e300,1e300,0", "--up") - Vec3(1, 1, 0).normalized()).norm(), 1e-15);
  EXPECT_THAT(error_of([] { (void)parse_direction("0,0,0", "--up"); }), StartsWith("--up: has no length"));
  EXPECT_THAT(error_of([] { (void)parse_direction("0,1mm,0", "--up"); }), StartsWith("--up is '0,1mm,0'; it must be"));
}

}  // namespace
}  // namespace haptrace
