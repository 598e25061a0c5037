#include "base/json_reader.h"

#include "tests/formats/support.h"
#include "tests/support/errors.h"

#include <limits>

namespace haptrace {
namespace {

using nlohmann::json;
using test::error_of;
using testing::HasSubstr;

TEST(ParseJson, AllowsComments) {
  EXPECT_EQ(parse_json("{ /* block */ \"a\": 1 // line\n}", "x")["a"], 1);
}

TEST(ParseJson, NamesLineAndColumn) {
  expect_error([] { parse_json("{\n  \"a\": 1,\n  b: 2\n}", "my.json"); }, Error::Kind::input,
               {"my.json: line 3, column 3: ", "syntax error"});
  expect_error([] { parse_json("", "option --gains"); }, Error::Kind::input, {"option --gains: line 1, column 1: "});
  expect_error([] { parse_json("[1e999]", "my.json"); }, Error::Kind::input, {"my.json: number overflow", "1e999"});
}

TEST(ParseJson, RefusesADuplicateKey) {
  expect_error([] { parse_json(R"({"a": {"b": 1, "c": 2, "b": 3}})", "my.json"); }, Error::Kind::input,
               {"my.json: key 'b' appears twice"});
  EXPECT_NO_THROW(parse_json(R"({"a": {"b": 1}, "b": {"a": 1}})", "my.json"));
}

TEST(ParseJson, RefusesNestingThatIsTooDeepToBeShownOrCopied) {
  const auto nested = [](std::size_t levels) { return std::string(levels, '[') + std::string(levels, ']'); };
  EXPECT_NO_THROW(parse_json(nested(100), "my.json"));
  expect_error([&] { parse_json(nested(1'000'000), "my.json"); }, Error::Kind::input,
               {"my.json: is nested deeper than 100 levels"});
}

TEST(LoadJson, SaysWhyAFileCannotBeRead) {
  const TempFolder folder;
  expect_error([&] { load_json(folder / "absent.json"); }, Error::Kind::input,
               {"absent.json: cannot be read: No such file"});
  expect_error([&] { load_json(folder.path()); }, Error::Kind::input, {"is a folder"});
  const std::string file = folder.write("bad.json", "{\"a\": }");
  expect_error([&] { load_json(file); }, Error::Kind::input, {file + ": line 1, column 7: "});
}

TEST(JsonReader, AnswersWithTheValueOrTheFallback) {
  const json object =
      parse_json(R"({"n": 2, "v": [1, 2, 3], "s": 0.5, "b": true, "t": "x", "o": {"n": 7}})", "my.json");
  JsonReader reader(object, "my.json");
  EXPECT_EQ(reader.number("n", 0), 2);
  EXPECT_EQ(reader.number("absent", 4), 4);
  EXPECT_EQ(reader.vector("v", Vec3::Zero()), Vec3(1, 2, 3));
  EXPECT_EQ(reader.vector("s", Vec3::Zero()), Vec3(0.5, 0.5, 0.5));
  EXPECT_EQ(reader.vector("absent", Vec3(7, 8, 9)), Vec3(7, 8, 9));
  EXPECT_TRUE(reader.boolean("b", false));
  EXPECT_EQ(reader.text("t", ""), "x");
  EXPECT_EQ(reader.text("absent", "y"), "y");
  EXPECT_FALSE(reader.object("absent").has_value());
  EXPECT_EQ(reader.object("o")->number("n", 0), 7);
  EXPECT_TRUE(reader.has("n"));
  EXPECT_FALSE(reader.has("absent"));
  EXPECT_NO_THROW(reader.finish());
}

TEST(JsonReader, NamesThePathOfAKeyThatIsWrong) {
  const json object = parse_json(R"({"hand": {"mass": [1, "two", 3], "arm": {"stiffness": -4, "grip": "x"}, "n": null},
                                     "v": [1, 2], "b": 1, "t": 2, "n": "3"})",
                                 "my.json");
  JsonReader reader(object, "my.json");
  auto hand = reader.object("hand");
  EXPECT_EQ(hand->where(), "my.json: hand");
  const auto bad = [](const auto& ask, const std::string& message) {
    expect_error(ask, Error::Kind::input, {message});
  };
  bad([&] { hand->vector("mass", Vec3::Zero()); }, "my.json: hand.mass[1]: expected a number, found \"two\"");
  bad([&] { hand->object("arm")->number("stiffness", 0, 0); },
      "my.json: hand.arm.stiffness: -4 is too small; the minimum is 0");
  bad([&] { hand->object("arm")->number("stiffness", 0, -9, -5); }, "-4 is too large; the maximum is -5");
  bad([&] { hand->number("n", 0); }, "my.json: hand.n: expected a number, found null");
  bad([&] { reader.vector("v", Vec3::Zero()); },
      "my.json: v: expected a number or an array of three numbers, found [1,2]");
  bad([&] { reader.boolean("b", false); }, "my.json: b: expected true or false, found 1");
  bad([&] { reader.text("t", ""); }, "my.json: t: expected text in quotes, found 2");
  bad([&] { reader.number("n", 0); }, "my.json: n: expected a number, found \"3\"");
  bad([&] { reader.object("v"); }, "my.json: v: expected an object, found [1,2]");
  bad([&] { JsonReader(object["v"], "my.json"); }, "my.json: expected an object, found [1,2]");
}

TEST(JsonReader, RefusesNumbersThatAreNotFinite) {
  const json object{{"n", std::numeric_limits<double>::infinity()}};
  expect_error([&] { JsonReader(object, "options").number("n", 0); }, Error::Kind::input,
               {"options: n: inf is not a finite number"});
}

TEST(JsonReader, ReadsLengthsAsNumbersAndAsTextWithAUnit) {
  const json object = json::parse(
      R"({"si": 0.02, "mm": "1mm", "cm": "1.5 cm", "in": "2e0in", "bare": "1", "time": "1s", "far": "3mm"})");
  JsonReader reader(object, "my.json");
  EXPECT_EQ(reader.length("si", 0, 0, 1), 0.02);
  EXPECT_DOUBLE_EQ(reader.length("mm", 0, 0, 1), 1e-3);
  EXPECT_DOUBLE_EQ(reader.length("cm", 0, 0, 1), 0.015);
  EXPECT_DOUBLE_EQ(reader.length("in", 0, 0, 1), 0.0508);
  EXPECT_EQ(reader.length("absent", 0.5, 0, 1), 0.5);
  EXPECT_THROW((void)reader.length("bare", 0, 0, 1), Error);
  EXPECT_THROW((void)reader.length("time", 0, 0, 1), Error);
  EXPECT_THROW((void)reader.length("far", 0, 0, 1e-3), Error);
}

TEST(JsonReader, SuggestsKeysThatWereOnlyLookedFor) {
  const json object{{"suport", 1}};
  JsonReader reader(object, "p.json");
  EXPECT_FALSE(reader.has("support"));
  EXPECT_THAT(error_of([&] { reader.finish(); }), HasSubstr("support"));
}

TEST(JsonReader, RefusesAKeyThatWasOnlyLookedForAndNotRead) {
  const json object{{"support", 1}};
  JsonReader reader(object, "p.json");
  EXPECT_TRUE(reader.has("support"));
  EXPECT_THAT(error_of([&] { reader.finish(); }), HasSubstr("p.json: key 'support' is not known"));
  (void)reader.number("support", 0);
  EXPECT_TRUE(reader.has("support")) << "it does not forget that the key was read";
  EXPECT_NO_THROW(reader.finish());
}

TEST(JsonReader, ReadsListsOfNumbersAndDirections) {
  const json object =
      json::parse(R"({"f": [1, 2.5], "a": [0, -0.5, 0], "long": [1, 2, 3], "none": [], "zero": [0, 0, 0],
                                      "text": "3cm", "big": [1, 7], "small": [0, 0, 1e-4]})");
  JsonReader reader(object, "x");
  EXPECT_EQ(reader.numbers("f", {}, 2), (std::vector<double>{1, 2.5}));
  EXPECT_EQ(reader.numbers("absent", {4}, 2), (std::vector<double>{4}));
  EXPECT_EQ(reader.direction("a", Vec3::UnitX()), -Vec3::UnitY());
  EXPECT_EQ(reader.direction("absent", Vec3::UnitX()), Vec3::UnitX());
  EXPECT_EQ(reader.direction("small", Vec3::UnitX()), Vec3::UnitZ());
  EXPECT_THAT(error_of([&] { (void)reader.numbers("long", {}, 2); }), HasSubstr("x: long: expected a list of 1 to 2"));
  EXPECT_THAT(error_of([&] { (void)reader.numbers("none", {}, 2); }), HasSubstr("x: none: expected a list of 1 to 2"));
  EXPECT_THAT(error_of([&] { (void)reader.numbers("big", {}, 2, 0, 5); }), HasSubstr("x: big[1]: 7 is too large"));
  EXPECT_THAT(error_of([&] { (void)reader.direction("zero", Vec3::UnitX()); }), HasSubstr("x: zero: has no length"));
  EXPECT_THAT(error_of([&] {
                (void)JsonReader(json{{"a", 0.5}}, "x").direction("a", Vec3::UnitX());
              }),
              HasSubstr("x: a: expected an array of three numbers, found 0.5"))
      << "one number for all axes is a diagonal that nobody means";
  EXPECT_THAT(error_of([&] { (void)reader.number("text", 0); }), HasSubstr("without quotes and units"));
}

TEST(JsonReader, NamesTheTypoBehindAMissingKey) {
  const json object = json::parse(R"({"kind": "box", "stifness": 800})");
  JsonReader reader(object, "x");
  (void)reader.text("kind", "");
  EXPECT_THAT(error_of([&] { (void)reader.require("stiffness"); }),
              HasSubstr("'stiffness' is missing; is 'stifness' meant to be it?"));
  EXPECT_EQ(error_of([&] { (void)reader.require("radius"); }), "x: 'radius' is missing");
}

TEST(JsonReader, RefusesAnUnknownKeyAndSuggestsTheNearest) {
  const json object{{"stifness", 3}};
  JsonReader reader(object, "my.json");
  reader.number("stiffness", 0);
  reader.number("damping", 0);
  expect_error([&] { reader.finish(); }, Error::Kind::input,
               {"my.json: key 'stifness' is not known; did you mean 'stiffness'?"});
}

TEST(TextIn, AnswersWithNothingWhereThereIsNoText) {
  const json object{{"mode", "free"}, {"support", 2.5}};
  EXPECT_EQ(text_in(object, "mode"), "free");
  EXPECT_EQ(text_in(object, "support"), "");
  EXPECT_EQ(text_in(object, "feel", "active"), "active");
  EXPECT_EQ(text_in(json::array(), "mode"), "");
  EXPECT_EQ(text_in(nullptr, "mode"), "");
}

TEST(NumberIn, AnswersWithNothingWhereThereIsNoNumber) {
  const json object{{"mode", "free"}, {"support", 2.5}};
  EXPECT_EQ(number_in(object, "support"), 2.5);
  EXPECT_EQ(number_in(object, "mode"), std::nullopt);
  EXPECT_EQ(number_in(object, "speed"), std::nullopt);
  EXPECT_EQ(number_in(json::array(), "speed"), std::nullopt);
}

}  // namespace
}  // namespace haptrace
