// Helpers for the tests of formats: temporary folders, random sessions, and checks of error messages.
#pragma once

#include "base/error.h"
#include "formats/recording/recording_layout.h"
#include "tests/support/temp_folder.h"

#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <gtest/gtest.h>
#include <initializer_list>
#include <iterator>
#include <random>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

using test::read_bytes;
using test::TempFolder;

/// Expects an Error of this kind whose message contains all `parts`.
template <class Action>
void expect_error(const Action& action, Error::Kind kind, std::initializer_list<std::string> parts) {
  try {
    action();
    ADD_FAILURE() << "no error; expected: " << *parts.begin();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind) << error.what();
    for (const std::string& part : parts)
      EXPECT_NE(std::string_view(error.what()).find(part), std::string_view::npos)
          << "message: " << error.what() << "\nlacks:   " << part;
  }
}

/// Returns the combinations of optional columns; reference_orientation comes with orientation and reference, gains with
/// torque and reference.
inline std::vector<RecordingColumns> all_columns() {
  std::vector<RecordingColumns> all;
  for (unsigned bits = 0; bits < 64; ++bits)
    all.push_back({.orientation = (bits & 1U) != 0,
                   .torque = (bits & 2U) != 0,
                   .force_measured = (bits & 4U) != 0,
                   .reference = (bits & 8U) != 0,
                   .guidance = (bits & 16U) != 0,
                   .tunnel = (bits & 32U) != 0,
                   .reference_orientation = (bits & 9U) == 9,
                   .gains = (bits & 10U) == 10});
  return all;
}

/// Returns a valid session at 1 kHz, with random values in all chosen columns. The other columns have their values for
/// "not measured".
inline std::vector<Sample> random_session(unsigned seed, std::size_t rows, const RecordingColumns& columns) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> number(-1, 1);
  const auto vector = [&](bool chosen = true) {
    return chosen ? Vec3(number(random), number(random), number(random)) : nan3();
  };
  std::vector<Sample> session(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    Sample& s = session[i];
    s.tick = i;
    s.latency = static_cast<float>(1e-5 * (1 + number(random)));
    s.time_ns = static_cast<std::int64_t>(i) * 1'000'000;
    s.position = 0.1 * vector();
    s.velocity = vector();
    s.force = vector();
    if (columns.orientation) s.orientation = Quat(number(random), number(random), number(random), 1.5).normalized();
    if (columns.reference_orientation)
      s.reference_orientation = Quat(1.5, number(random), number(random), number(random)).normalized();
    s.torque = vector(columns.torque);
    s.force_measured = vector(columns.force_measured);
    s.support = vector(columns.support);
    s.reference_position = vector(columns.reference);
    s.reference_velocity = vector(columns.reference);
    s.reference_force = vector(columns.guidance);
    s.progress = columns.guidance ? number(random) : kNaN;
    s.tunnel_radius = columns.tunnel ? number(random) : kNaN;
    s.kp = vector(columns.gains);
    s.kd = vector(columns.gains);
    s.buttons = static_cast<std::uint32_t>(random());
    s.phase = static_cast<Phase>(random() % 6);
  }
  return session;
}

/// Returns the bytes of one column of a session, as a file stores them.
inline std::string bytes_of(const layout::Column& column, std::span<const Sample> samples) {
  std::string bytes(samples.size() * column.row_bytes(), '\0');
  column.pack(samples, reinterpret_cast<std::byte*>(bytes.data()));
  return bytes;
}

/// Expects bitwise equality in every column, also in those that a file lacks: "not measured" stays NaN.
inline void expect_same(std::span<const Sample> actual, std::span<const Sample> expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (const layout::Column& column : layout::columns())
    EXPECT_TRUE(bytes_of(column, actual) == bytes_of(column, expected)) << "differs: " << column.path();
}

/// Writes a finished recording.
inline void write_recording(const std::string& file, std::span<const Sample> session,
                            const RecordingColumns& columns = {}, const RecordingHeader& header = {},
                            const std::vector<StoredEvent>& events = {}) {
  RecordingWriter writer(file, header, columns, {.storage = {.rows_per_chunk = 100}});
  writer.append(session);
  for (const StoredEvent& event : events) writer.append(event);
  writer.finish();
}

}  // namespace haptrace
