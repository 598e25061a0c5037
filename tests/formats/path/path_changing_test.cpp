#include "formats/path/path_changing.h"

#include "control/path/shapes.h"
#include "tests/formats/support.h"

namespace haptrace {
namespace {

std::shared_ptr<const PathSource> circle() {
  return source_of(make_shape("circle", {.size = 0.1, .duration = 20, .centre = Vec3(0.02, 0, 0.01)}));
}

void expect_facts_of_rows(const PathSource& path) {
  const Path rows = path.read(0, path.facts().rows);
  EXPECT_LT((rows.bounds().min - path.facts().bounds.min).norm(), 1e-12);
  EXPECT_LT((rows.bounds().max - path.facts().bounds.max).norm(), 1e-12);
  const auto again = source_of(rows);
  EXPECT_NEAR(again->facts().peak_speed, path.facts().peak_speed, 1e-9);
  ASSERT_EQ(again->blocks().size(), path.blocks().size());
  for (std::size_t i = 0; i < path.blocks().size(); ++i) {
    EXPECT_LT((again->blocks()[i].bounds.min - path.blocks()[i].bounds.min).norm(), 1e-12);
    EXPECT_NEAR(again->blocks()[i].peak_speed, path.blocks()[i].peak_speed, 1e-9);
  }
}

TEST(ChangedPath, StatesTheBoundsAndSpeedsOfItsRows) {
  for (const char* rotation : {"z=90deg", "x=-180deg", "z=30deg", "1,2,3=1"})
    for (const char* about : {"origin", "start", "centre"}) {
      const PathChange change{.mirror = 1,
                              .rotation = parse_rotation(rotation),
                              .scale = 0.7,
                              .about = parse_change_centre(about),
                              .offset = Vec3(0.01, 0, 0)};
      const auto path = circle();
      const auto moved = changed(path, similarity_of(change, *path));
      expect_facts_of_rows(*moved);
      Path rows = path->read(0, path->facts().rows);
      change.apply(rows);
      EXPECT_EQ(moved->read(1234, 1).position.front(), rows.position[1234]);
      EXPECT_EQ(moved->row_at(1.2345), path->row_at(1.2345));
    }
}

TEST(ChangedPath, IsThePathItselfWithoutAChange) {
  const auto path = circle();
  EXPECT_EQ(changed(path, similarity_of({}, *path)), path);
}

TEST(ChangedPath, RejectsAScaleThatMakesItLargerThanAnyWorkspace) {
  const std::shared_ptr<const PathSource> path = source_of(make_shape("circle", {.size = 5}));
  expect_error([&] { (void)changed(path, similarity_of({.scale = 50}, *path)); }, Error::Kind::input, {"m wide"});
}

}  // namespace
}  // namespace haptrace
