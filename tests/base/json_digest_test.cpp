#include "base/json_digest.h"

#include "base/json_reader.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>

namespace haptrace {
namespace {

using nlohmann::json;
using test::error_of;
using test::TempFolder;
using testing::HasSubstr;

const json kObject{{"name", "b\xff\"\\"},
                   {"numbers", {0.1 + 0.2, 1e-300, -0.0, 5, std::numeric_limits<double>::quiet_NaN()}},
                   {"deep", {{"flag", true}, {"none", nullptr}}}};

TEST(JsonDigest, IsKeptByAFileAndTakenOutOfIt) {
  const TempFolder folder;
  const std::string file = folder / "a.json";
  save_json(with_digest(kObject), file, false);
  json back = without_digest(load_json(file), file, "");
  EXPECT_FALSE(back.contains("digest"));
  EXPECT_EQ(back["numbers"][0], 0.1 + 0.2);
  EXPECT_EQ(with_digest(back)["digest"], with_digest(kObject)["digest"]);
}

TEST(JsonDigest, TellsThatAnythingWasChangedAndHowToMendIt) {
  for (const char* change : {"/name", "/numbers/0", "/numbers/3", "/deep/flag", "/deep/more", "/digest"}) {
    SCOPED_TRACE(change);
    json changed = with_digest(kObject);
    changed[json::json_pointer(change)] = 7;
    EXPECT_THAT(error_of([&] { (void)without_digest(changed, "a.json", "measure again"); }),
                HasSubstr("a.json: its content is no longer what was written; measure again"));
  }
  json removed = with_digest(kObject);
  removed.erase("deep");
  EXPECT_THROW((void)without_digest(removed, "a.json", ""), Error);
}

TEST(JsonDigest, IsNotMissedInOlderFiles) {
  EXPECT_EQ(without_digest(kObject["deep"], "a.json", ""), kObject["deep"]);
  EXPECT_EQ(without_digest(json::array({1}), "a.json", ""), json::array({1}));
}

}  // namespace
}  // namespace haptrace
