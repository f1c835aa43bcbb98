#include "slam/output/internal/png_file.hpp"

#include <png.h>

#include <csetjmp>
#include <cstddef>
#include <vector>

#include "slam/base/atomic_file.hpp"

namespace submapd::internal {
namespace {

constexpr int kCompressionLevel = 3;

// What libpng's callbacks see of the file being written.
struct Sink {
  AtomicFile file;
  Status status;        // the file's first error
  std::string message;  // libpng's, if it gave up for a reason of its own
};

extern "C" {

static void submapd_png_write(png_structp png, png_bytep data, png_size_t size) {
  Sink& sink = *static_cast<Sink*>(png_get_io_ptr(png));
  sink.status = sink.file.write(std::as_bytes(std::span(data, size)));
  if (!sink.status.ok()) png_error(png, "write failed");
}

static void submapd_png_flush(png_structp) {}

static void submapd_png_error(png_structp png, png_const_charp message) {
  static_cast<Sink*>(png_get_error_ptr(png))->message = message;
  png_longjmp(png, 1);
}

static void submapd_png_warning(png_structp, png_const_charp) {}

}  // extern "C"

// libpng leaves by longjmp: between here and its calls lives nothing that has a destructor.
bool encode(png_structp png, png_infop info, const Canvas& canvas, png_textp texts, int text_count) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_IHDR(png, info, static_cast<png_uint_32>(canvas.width()), static_cast<png_uint_32>(canvas.height()), 8,
               PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  // Flat colours: unfiltered they come out smaller, and in a third of the time.
  png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_NONE);
  png_set_compression_level(png, kCompressionLevel);
  png_set_text(png, info, texts, text_count);
  png_write_info(png, info);
  for (int y = 0; y < canvas.height(); ++y) png_write_row(png, canvas.row(y).data());
  png_write_end(png, info);
  return true;
}

}  // namespace

Status write_png(const std::filesystem::path& path, const Canvas& canvas, std::span<const PngText> texts) {
  std::vector<png_text> chunks(texts.size());
  for (std::size_t i = 0; i < texts.size(); ++i) {
    chunks[i].compression = PNG_TEXT_COMPRESSION_NONE;
    // libpng's interface lacks the const; it copies both.
    chunks[i].key = const_cast<char*>(texts[i].keyword.c_str());
    chunks[i].text = const_cast<char*>(texts[i].text.c_str());
    chunks[i].text_length = texts[i].text.size();
  }

  Sink sink{AtomicFile(path), {}, {}};
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &sink, submapd_png_error, submapd_png_warning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  bool done = false;
  if (info != nullptr) {
    png_set_write_fn(png, &sink, submapd_png_write, submapd_png_flush);
    done = encode(png, info, canvas, chunks.data(), static_cast<int>(chunks.size()));
  }
  png_destroy_write_struct(&png, &info);
  if (!sink.status.ok()) return sink.status;
  if (!done) return Status(StatusCode::kInternal, path.string() + ": libpng: " + sink.message);
  return sink.file.commit();
}

}  // namespace submapd::internal
