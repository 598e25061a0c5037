// The programme schema for editors and other programs agrees with haptrace's reader.
#include "base/json_reader.h"
#include "formats/documents/programme.h"
#include "tests/formats/support.h"

#include <fmt/format.h>

namespace haptrace {
namespace {

using nlohmann::json;

bool is_read(const json& programme) {
  try {
    (void)programme_from_json(programme, "p.json");
    return true;
  } catch (const Error&) {
    return false;
  }
}

/// Returns whether the reader refuses a relation of values, which a schema cannot state.
bool relates_values(const json& programme) {
  try {
    (void)programme_from_json(programme, "p");
  } catch (const Error& error) {
    const std::string why = error.what();
    for (const char* words :
         {"from the start, within start_radius", "leads out of the plane", "must not be above most",
          "no reach can end within time_limit", "is none; raise the share", "is in the start",
          "has no length, so it is no direction", "lies in the same direction as", "tracking lasts", "a press lasts",
          "a weight takes", "no exercise before it measures it", "the same number is there twice",
          "two sines have the same frequency", "can be followed: lower amplitude"})
      if (why.find(words) != std::string::npos) return true;
  }
  return false;
}

/// Returns for each programme whether it is valid by the schema.
std::vector<bool> by_schema(const std::vector<json>& programmes) {
  const TempFolder folder;
  std::string lines;
  for (const json& programme : programmes) lines += programme.dump() + "\n";
  const std::string file = folder.write("programmes.jsonl", lines);
  const std::string script = folder.write("check.py", R"(
import json, sys, jsonschema
schema = json.load(open(sys.argv[1]))
jsonschema.Draft7Validator.check_schema(schema)
validator = jsonschema.Draft7Validator(schema)
print("".join("1" if validator.is_valid(json.loads(line)) else "0" for line in open(sys.argv[2])))
)");
  const std::string answer = folder / "answer.txt";
  const std::string command =
      fmt::format("{} {} {}/programme.schema.json {} > {}", HAPTRACE_PYTHON, script, HAPTRACE_FORMATS, file, answer);
  EXPECT_EQ(std::system(command.c_str()), 0);
  std::vector<bool> valid;
  for (const char c : read_bytes(answer))
    if (c == '0' || c == '1') valid.push_back(c == '1');
  return valid;
}

/// Appends copies of the programme with one change each, for every element: a missing key, an unknown key, a value of
/// another type or out of range, another mode.
void change_everything(const json& whole, const json& part, const json::json_pointer& at, std::vector<json>& changed) {
  const auto with = [&](const json& value) {
    json copy = whole;
    copy[at] = value;
    changed.push_back(std::move(copy));
  };
  if (part.is_object()) {
    json more = part;
    more["zzz"] = 1;
    with(more);
    for (const auto& [key, value] : part.items()) {
      json less = part;
      less.erase(key);
      with(less);
      change_everything(whole, value, at / key, changed);
    }
  } else if (part.is_array()) {
    with(json::object());
    for (std::size_t i = 0; i < part.size(); ++i) change_everything(whole, part[i], at / i, changed);
  } else if (at.back() == "mode") {
    for (const char* mode : {"passive", "assisted", "tunnel", "cursor", "resist", "free", "reach", "range", "press",
                             "track", "weigh", "sense", "other"})
      with(mode);
  } else {
    for (const json& value :
         {json(-1), json(0), json(1), json(0.5), json(1e12), json("text"), json(nullptr), json(true)}) {
      // The formats layer does not know the names of the figures: it accepts any string.
      if (at.back() == "figure" && value.is_string()) continue;
      with(value);
    }
  }
}

TEST(ProgrammeSchema, AgreesWithTheReaderOnEverySampleHoweverItIsChanged) {
  std::vector<json> programmes;
  for (const char* name : {"reaching", "circles", "lesson", "field", "assessments"}) {
    const json sample = load_json(fmt::format("{}/programmes/{}.json", HAPTRACE_SAMPLES, name));
    EXPECT_TRUE(is_read(sample));
    json few = sample;
    // The eight directions are the same exercise eight times.
    while (few["exercises"].size() > 5) few["exercises"].erase(few["exercises"].size() - 1);
    programmes.push_back(sample);
    change_everything(few, few, json::json_pointer(), programmes);
  }
  const json placed = json::parse(R"({"haptrace_programme": 1,
      "person": {"mirror": "x", "rotate": "y=-.5e-1", "scale": 0.5, "about": [0, 0.1, 0], "offset": 0.01},
      "exercises": [{"path": "a.h5", "mode": "passive", "mirror": "z", "rotate": "1,2,-3.5=90deg", "about": "centre",
                     "scale": 2, "offset": [0.01, 0, 0], "frame": {"translation": [1, 0, 0]}}]})");
  EXPECT_TRUE(is_read(placed));
  change_everything(placed, placed, json::json_pointer(), programmes);
  for (const char* spelling : {"centre", "center"}) {
    json shaped = json::parse(R"({"haptrace_programme": 1, "exercises": [
        {"mode": "passive", "shape": {"kind": "circle", "size": 0.05}},
        {"mode": "passive", "shape": {"kind": "circle"}}]})");
    shaped["exercises"][0]["shape"][spelling] = {0.01, 0, 0};
    shaped["exercises"][1]["shape"][spelling] = 0.01;
    EXPECT_TRUE(is_read(shaped));
    change_everything(shaped, shaped, json::json_pointer(), programmes);
  }
  const json twice = json::parse(R"({"haptrace_programme": 1, "exercises": [
      {"mode": "passive", "shape": {"kind": "circle", "centre": 0.01, "center": 0.01}}]})");
  EXPECT_FALSE(is_read(twice));
  programmes.push_back(twice);
  const json reaches = json::parse(R"({"haptrace_programme": 1, "exercises": [
      {"mode": "reach", "repetitions": 3, "mirror": "x", "reach": {"targets": [[0, 0.1, 0], [0, 0, 0.1]], "plane": "yz",
       "start_hold": 0.7, "start_radius": 0.005, "energy": 1, "field": {"matrix": [[0, 1], [2, 3]]},
       "clamp": {"damping": 5, "break_out": 0.02}}},
      {"mode": "reach", "reach": {"targets": {"kind": "centre-out", "first_angle_deg": 10},
       "field": {"matrix": [[0, 1, 2], [2, 3, 4], [5, 6, 7]]}, "blocks": [{"reaches": 9, "field": true}]}}]})");
  EXPECT_TRUE(is_read(reaches));
  change_everything(reaches, reaches, json::json_pointer(), programmes);
  const json assessed = json::parse(R"({"haptrace_programme": 1, "exercises": [
      {"mode": "range", "range": {"targets": [[0, 0.1, 0]], "plane": "yz", "start": [0, 0.01, 0], "pull": true,
       "start_radius": 0.005, "start_hold": {"least": 0.5, "most": 1}, "target_hold": 1, "tries": 2}},
      {"mode": "press", "time_limit": 4, "press": {"targets": [[0, 0.1, 0]], "stiffness": 500, "damping": 2,
       "break_out": 0.02, "energy": 1, "locked": false}},
      {"mode": "press", "press": {"targets": [[0, 0.1, 0]], "locked": true}},
      {"mode": "track", "repetitions": 2, "track": {"axis": [0, 1, 0], "frequencies": [0.2, 0.5], "pattern": 3,
       "amplitude": 0.02, "discard": 4, "start": 0.01}},
      {"mode": "sense", "sense": {"axis": [0, 1, 0], "reference": 0.02, "differences": [0.001, 0.02], "tries": 4,
       "move": 0.5, "stay": 0.6, "answer_time": 5, "start": [0, 0.01, 0]}}]})");
  EXPECT_TRUE(is_read(assessed));
  change_everything(assessed, assessed, json::json_pointer(), programmes);
  const json supported = json::parse(R"({"haptrace_programme": 1, "support": {"share": 0.5}, "up": [0, 0, 1],
      "warm_up": [{"mode": "weigh", "weigh": {"tries": 2, "start": [0, 0.01, 0], "stiffness": 300, "energy": 1}}],
      "exercises": [{"path": "a.h5", "mode": "free", "support": 2}, {"path": "a.h5", "mode": "tunnel"},
                    {"mode": "press", "press": {"targets": [[0, 0.1, 0]]}}]})");
  EXPECT_TRUE(is_read(supported));
  change_everything(supported, supported, json::json_pointer(), programmes);
  ASSERT_GT(programmes.size(), 1000U);
  const std::vector<bool> valid = by_schema(programmes);
  ASSERT_EQ(valid.size(), programmes.size());
  for (std::size_t i = 0; i < valid.size(); ++i)
    EXPECT_TRUE(is_read(programmes[i]) == valid[i] || (valid[i] && relates_values(programmes[i])))
        << (valid[i] ? "only the schema takes " : "only the reader takes ") << programmes[i].dump();
}

}  // namespace
}  // namespace haptrace
