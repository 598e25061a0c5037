#include "formats/recording/storage_report.h"

#include "base/error.h"
#include "formats/recording/hdf5_support.h"
#include "formats/recording/recording_layout.h"

#include <cmath>
#include <cstring>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// Accumulates the differences of one column.
struct Loss {
  double squares = 0, largest = 0;
  std::uint64_t count = 0;

  void add(const layout::Column& column, std::span<const Sample> original, std::span<const Sample> stored) {
    const std::size_t numbers = original.size() * column.width;
    std::vector<double> a(numbers), b(numbers);
    column.pack(original, reinterpret_cast<std::byte*>(a.data()));
    column.pack(stored, reinterpret_cast<std::byte*>(b.data()));
    for (std::size_t i = 0; i < numbers; ++i) {
      const double difference = std::abs(a[i] - b[i]);
      if (!std::isfinite(difference)) continue;
      squares += difference * difference;
      largest = std::max(largest, difference);
      ++count;
    }
  }
};

}  // namespace

std::vector<StoredColumn> report_storage(const std::string& file, RecordingSource& original) {
  const RecordingReader reader(file);
  std::vector<const layout::Column*> columns;
  for (const layout::Column& column : layout::columns())
    if (column.in(reader.columns())) columns.push_back(&column);

  std::vector<Loss> losses(columns.size());
  std::uint64_t row = 0;
  std::int64_t first_ns = 0, last_ns = 0;
  for (std::span<const Sample> block = original.next(); !block.empty(); block = original.next()) {
    const std::vector<Sample> stored = reader.read(row, block.size());
    if (stored.size() != block.size())
      throw input_error(
          fmt::format("{}: has {} samples, which is not the number that was written", file, reader.rows()));
    for (std::size_t i = 0; i < columns.size(); ++i)
      if (columns[i]->element == layout::Element::float64) losses[i].add(*columns[i], block, stored);
    if (row == 0) first_ns = block.front().time_ns;
    last_ns = block.back().time_ns;
    row += block.size();
  }
  if (row != reader.rows())
    throw input_error(fmt::format("{}: has {} rows, which is not what was written", file, reader.rows()));

  const hdf5::Silence silence;
  const hdf5::File opened = hdf5::open_to_read(file);
  const double hours = 1e-9 * static_cast<double>(last_ns - first_ns) / 3600;
  std::vector<StoredColumn> report;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const hdf5::Dataset dataset = hdf5::open_dataset(opened.get(), columns[i]->path());
    StoredColumn& stored = report.emplace_back();
    stored.name = columns[i]->name;
    stored.units = columns[i]->units;
    stored.raw_bytes = row * columns[i]->row_bytes();
    stored.stored_bytes = H5Dget_storage_size(dataset.get());
    stored.bytes_per_hour = hours > 0 ? static_cast<double>(stored.stored_bytes) / hours : 0;
    stored.max_loss = losses[i].largest;
    if (losses[i].count > 0) stored.rms_loss = std::sqrt(losses[i].squares / static_cast<double>(losses[i].count));
  }
  return report;
}

}  // namespace haptrace
