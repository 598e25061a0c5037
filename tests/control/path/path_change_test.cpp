#include "control/path/path_change.h"

#include "control/path/shapes.h"
#include "control/rotation.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using test::error_of;
using testing::AllOf;
using testing::HasSubstr;

class RandomChanges {
 public:
  explicit RandomChanges(unsigned seed) : random_(seed) {}

  double number(double most = 1) { return std::uniform_real_distribution<double>(-most, most)(random_); }
  Vec3 vector(double most = 1) { return {number(most), number(most), number(most)}; }
  Quat rotation() { return quaternion(vector(std::numbers::pi / 2)); }

  PathChange change() {
    PathChange change{.rotation = rotation(), .scale = std::exp(number(1.5)), .offset = vector(0.1)};
    if (number() > 0) change.mirror = static_cast<int>(random_() % 3);
    if (number() > 0) change.frame = DeviceFrame{.rotation = rotation(), .translation = vector(0.5)};
    change.about.kind = static_cast<ChangeCentre::Kind>(random_() % 4);
    change.about.point = vector(0.2);
    if (number() > 0) change.start = vector(0.1);
    return change;
  }

  Path path(std::size_t rows = 20) {
    Path path{.name = "random"};
    for (std::size_t i = 0; i < rows; ++i) {
      path.time.push_back(0.01 * static_cast<double>(i));
      path.position.push_back(vector(0.1));
      path.velocity.push_back(vector());
      path.force.push_back(vector(5));
      path.orientation.push_back(rotation());
    }
    return path;
  }

 private:
  std::mt19937_64 random_;
};

void expect_same(const Path& a, const Path& b, double tolerance) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a.time, b.time);
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_LT((a.position[i] - b.position[i]).norm(), tolerance);
    EXPECT_LT((a.velocity[i] - b.velocity[i]).norm(), tolerance);
    EXPECT_LT((a.force[i] - b.force[i]).norm(), tolerance);
    EXPECT_LT(rotation_between(a.orientation[i], b.orientation[i]).norm(), 1e-7) << "acos of nearly 1";
    EXPECT_NEAR(std::abs(a.orientation[i].dot(b.orientation[i])), 1, tolerance);
  }
}

TEST(PathChange, IsUndoneByItsInverse) {
  RandomChanges random(1);
  for (int i = 0; i < 500; ++i) {
    const PathChange change = random.change();
    const Path path = random.path();
    const Similarity similarity = change.of(path.position.front(), path.bounds());
    Path there = path;
    similarity.apply(there);
    Path back = there;
    similarity.inverse().apply(back);
    expect_same(back, path, 1e-12);
    Path product = path;
    (similarity.inverse() * similarity).apply(product);
    expect_same(product, path, 1e-12);
  }
}

TEST(PathChange, DoesAProductLikeItsFactorsOneAfterAnother) {
  RandomChanges random(2);
  for (int i = 0; i < 200; ++i) {
    const Path path = random.path();
    const Similarity first = random.change().of(path.position.front(), path.bounds());
    const Similarity second = random.change().of(path.position.front(), path.bounds());
    Path one = path, other = path;
    first.apply(one);
    second.apply(one);
    (second * first).apply(other);
    expect_same(one, other, 1e-11);
  }
}

TEST(PathChange, IsTheIdentityWhenMirroredTwice) {
  RandomChanges random(3);
  for (int axis = 0; axis < 3; ++axis) {
    const PathChange change{.mirror = axis, .about = {.kind = ChangeCentre::Kind::centre}};
    const Path path = random.path();
    Path twice = path;
    change.apply(twice);
    EXPECT_GT((twice.position[3] - path.position[3]).norm(), 1e-6);
    change.apply(twice);
    expect_same(twice, path, 1e-15);
  }
}

TEST(PathChange, KeepsOrientationsAndDistancesWhateverItsAxis) {
  RandomChanges random(4);
  for (int i = 0; i < 200; ++i) {
    const PathChange change = random.change();
    const Path path = random.path();
    Path changed = path;
    change.apply(changed);
    validate(changed);
    for (std::size_t row = 1; row < path.size(); ++row) {
      EXPECT_NEAR((changed.position[row] - changed.position[0]).norm(),
                  change.scale * (path.position[row] - path.position[0]).norm(), 1e-12);
      EXPECT_NEAR(changed.force[row].norm(), path.force[row].norm(), 1e-12);
      EXPECT_NEAR(changed.velocity[row].norm(), change.scale * path.velocity[row].norm(), 1e-12);
      EXPECT_NEAR(changed.force[row].dot(changed.velocity[row]), change.scale * path.force[row].dot(path.velocity[row]),
                  1e-11)
          << "the power of the force";
    }
  }
}

TEST(PathChange, MirrorsRotatesScalesAndMovesInThisOrderAboutOnePoint) {
  PathChange change{.mirror = 0,
                    .rotation = parse_rotation("z=90deg"),
                    .scale = 2,
                    .about = parse_change_centre("0.1,0,0"),
                    .offset = Vec3(0, 0, 0.01)};
  // 0.03 beyond the point in x: mirrored -0.03 in x, rotated -0.03 in y, scaled -0.06, moved.
  Path path{.name = "p", .time = {0}, .position = {Vec3(0.13, 0, 0)}, .force = {Vec3(1, 0, 0)}};
  change.apply(path);
  EXPECT_LT((path.position[0] - Vec3(0.1, -0.06, 0.01)).norm(), 1e-15);
  EXPECT_EQ(path.force[0], Vec3(0, -1, 0)) << "forces turn, are not scaled and have no rounding error";
  EXPECT_EQ(describe(change),
            "mirrored in x, rotated by 90 degrees about z, scaled by 2 about 100, 0, 0 mm, moved by "
            "0, 0, 10 mm");
}

TEST(PathChange, TurnsAboutTheStartOrTheCentreAndLeavesIt) {
  const Path path = make_shape("square", {.size = 0.08, .centre = Vec3(0.02, 0.03, 0)});
  for (const char* place : {"start", "centre"}) {
    Path changed = path;
    PathChange{.rotation = parse_rotation("1,2,3=2"), .scale = 0.5, .about = parse_change_centre(place)}.apply(changed);
    const bool start = std::string_view(place) == "start";
    EXPECT_LT(
        (start ? changed.position[0] - path.position[0] : changed.bounds().center() - path.bounds().center()).norm(),
        1e-4)
        << place;
  }
}

TEST(PathChange, MovesThePathsStartToThePlaceOfTheTool) {
  RandomChanges random(5);
  for (int i = 0; i < 50; ++i) {
    PathChange change = random.change();
    change.start = Vec3(0.01, 0.02, -0.03);
    Path path = random.path();
    change.apply(path);
    EXPECT_LT((path.position[0] - *change.start).norm(), 1e-13);
  }
}

TEST(PathChange, BringsTheWorldsCoordinatesToTheDevices) {
  // The device stands 1 m along the world's x, turned by 90 degrees about z: its x is the world's y.
  const DeviceFrame frame{.rotation = parse_rotation("z=90deg"), .translation = Vec3(1, 0, 0)};
  const Similarity to = to_device(frame);
  EXPECT_LT((to.point(Vec3(1, 0.1, 0)) - Vec3(0.1, 0, 0)).norm(), 1e-15);
  EXPECT_EQ(to.direction(Vec3(0, 1, 0)), Vec3(1, 0, 0));
  Path path{.name = "p", .time = {0}, .position = {Vec3(1, 0.1, 0)}};
  PathChange{.frame = frame, .scale = 2}.apply(path);
  EXPECT_LT((path.position[0] - Vec3(0.2, 0, 0)).norm(), 1e-15) << "scaled about the device's origin, not the world's";
}

TEST(PathChange, MirrorsATurningToolAsAMirrorDoes) {
  const PathChange change{.mirror = 0};
  const Similarity mirror = change.of(Vec3::Zero(), {Vec3::Zero(), Vec3::Zero()});
  // A right-handed turn about x stays one, about y and z it changes its sense.
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 turn = 0.3 * Vec3::Unit(axis);
    EXPECT_LT((rotation_vector(mirror.orientation(quaternion(turn))) - (axis == 0 ? turn : Vec3(-turn))).norm(), 1e-15);
    EXPECT_LT((mirror.torque(turn) - (axis == 0 ? turn : Vec3(-turn))).norm(), 1e-15);
  }
  EXPECT_FALSE(is_finite(mirror.orientation(nan_quat())));
  EXPECT_FALSE(is_finite(mirror.point(nan3())));
}

TEST(PathChange, RejectsInvalidValuesByName) {
  const auto error = [](PathChange change) { return error_of([&] { validate(change); }); };
  EXPECT_EQ(error({}), "no error");
  for (const double scale : {0.0, -1.0, 0.009, 101.0, kNaN, std::numeric_limits<double>::infinity()})
    EXPECT_THAT(error({.scale = scale}), HasSubstr("it must be from 0.01 to 100")) << scale;
  EXPECT_THAT(error({.rotation = nan_quat()}), HasSubstr("not a unit quaternion"));
  EXPECT_THAT(error({.rotation = Quat(2, 0, 0, 0)}), HasSubstr("not a unit quaternion"));
  EXPECT_THAT(error({.offset = Vec3(0, 20, 0)}), AllOf(HasSubstr("0, 20, 0 m"), HasSubstr("20mm")));
  EXPECT_THAT(error({.offset = nan3()}), HasSubstr("cannot be moved"));
  EXPECT_THAT(error({.about = {.point = nan3()}}), HasSubstr("cannot be moved"));
  EXPECT_THAT(error({.start = nan3()}), HasSubstr("not finite"));
  EXPECT_THAT(error({.mirror = 3}), HasSubstr("mirror axis is 3"));
  EXPECT_THAT(error({.frame = DeviceFrame{.rotation = nan_quat()}}), HasSubstr("not a unit quaternion"));
  EXPECT_THAT(error({.frame = DeviceFrame{.translation = nan3()}}), HasSubstr("not finite"));
}

TEST(PathChange, ReadsAxesAnglesAndPlacesWithUnits) {
  EXPECT_LT((rotation_vector(parse_rotation("z=90deg")) - Vec3(0, 0, std::numbers::pi / 2)).norm(), 1e-15);
  EXPECT_LT((rotation_vector(parse_rotation("y=-0.5")) - Vec3(0, -0.5, 0)).norm(), 1e-15);
  EXPECT_LT((rotation_vector(parse_rotation("1,1,0=1rad")) - Vec3(1, 1, 0).normalized()).norm(), 1e-15);
  EXPECT_LT((rotation_vector(parse_rotation("1e-300,0,0=1")) - Vec3(1, 0, 0)).norm(), 1e-15);
  EXPECT_LT((rotation_vector(parse_rotation("0,1e300,0=1")) - Vec3(0, 1, 0)).norm(), 1e-15);
  EXPECT_EQ(parse_change_centre("10mm,0,0").point, Vec3(0.01, 0, 0));
  EXPECT_EQ(parse_mirror("y"), 1);
  EXPECT_EQ(parse_mirror("none"), std::nullopt);
  for (const char* text :
       {"", "z", "z=", "z=ninety", "z=nan", "z=inf", "w=1", "0,0,0=1", "1,0=1", "z=3mm", "=1", "zz=1"})
    EXPECT_THAT(error_of([&] { (void)parse_rotation(text); }), HasSubstr("rotation")) << text;
  EXPECT_THAT(error_of([] { (void)parse_rotation("0,0,0=1"); }),
              HasSubstr("the axis of the rotation '0,0,0=1': has no length, so it is no direction"));
  EXPECT_THAT(error_of([] { (void)parse_rotation("z=90"); }), HasSubstr("z=90deg was meant? Otherwise write z=90rad"));
  EXPECT_LT((rotation_vector(parse_rotation("z=7rad")) - Vec3(0, 0, 7 - 2 * std::numbers::pi)).norm(), 1e-12);
  EXPECT_THAT(error_of([] { (void)parse_change_centre("end"); }), HasSubstr("origin, start, centre"));
  EXPECT_THAT(error_of([] { (void)parse_mirror("w"); }), HasSubstr("unknown mirror axis"));
}

}  // namespace
}  // namespace haptrace
