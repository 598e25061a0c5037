#include "cli/read_progress.h"
#include "formats/path_file.h"
#include "formats/recording_figure.h"

#include <filesystem>
#include <fmt/format.h>

namespace haptrace::cli {

Verb add_plot(CLI::App& app) {
  struct Arguments {
    std::string input, file;
    bool overwrite = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("plot", "draw a recording or a path: in space, deviation and force over time");
  verb->footer("  haptrace plot played.h5\n  haptrace plot played.h5 -o played.pdf");
  verb->add_option("file", arguments->input, "recording (HDF5) or path (CSV)")->type_name("FILE");
  verb->add_option("-o,--output", arguments->file, "picture, .png .svg or .pdf; else FILE.png beside the input");
  verb->add_flag("--overwrite", arguments->overwrite, "replace a file that exists");
  return {verb, [verb, arguments](const Output& output) {
            require(*verb, "file");
            const std::filesystem::path input = arguments->input;
            const std::string file = arguments->file.empty()
                                         ? std::filesystem::path(input).replace_extension(".png").string()
                                         : arguments->file;
            const Figure figure = [&] {
              if (!is_hdf5(arguments->input)) return figure_of(load_path(arguments->input));
              const RecordingReader reader(arguments->input);
              ReadProgress progress(output, arguments->input, reader.rows());
              return figure_of(reader, input.filename().string(), progress.callback());
            }();
            save_figure(figure, file, arguments->overwrite);
            output.tell({{"file", file}}, fmt::format("{}\n", file));
            return kDone;
          }};
}

}  // namespace haptrace::cli
