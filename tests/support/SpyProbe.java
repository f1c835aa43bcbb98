import java.awt.Component;
import java.awt.Container;
import java.awt.Frame;
import java.io.PrintWriter;
import java.lang.instrument.Instrumentation;
import java.lang.reflect.Field;
import java.nio.file.Files;
import java.nio.file.Path;
import java.nio.file.StandardCopyOption;
import java.util.List;
import javax.swing.JTable;
import javax.swing.SwingUtilities;

/**
 * Looks at the window of a running lcm-spy (java -javaagent:probe.jar=FILE): writes a line for each channel into FILE, some
 * times a second: channel and type as its table shows them, the class it decoded the newest message to, and that message's utime.
 */
public class SpyProbe {
  public static void premain(String file, Instrumentation unused) {
    Thread thread = new Thread(() -> run(Path.of(file)), "probe");
    thread.setDaemon(true);
    thread.start();
  }

  private static void run(Path file) {
    Path next = file.resolveSibling(file.getFileName() + ".new");
    try {
      for (;;) {
        Thread.sleep(200);
        StringBuilder lines = new StringBuilder();
        SwingUtilities.invokeAndWait(() -> {
          for (Frame frame : Frame.getFrames()) look(frame, lines);
        });
        Files.writeString(next, lines);
        Files.move(next, file, StandardCopyOption.ATOMIC_MOVE);
      }
    } catch (Exception error) {
      error.printStackTrace(new PrintWriter(System.err, true));
    }
  }

  private static void look(Component component, StringBuilder lines) {
    if (component instanceof JTable) {
      tell((JTable) component, lines);
    } else if (component instanceof Container) {
      for (Component part : ((Container) component).getComponents()) look(part, lines);
    }
  }

  private static void tell(JTable table, StringBuilder lines) {
    try {
      Object model = ((lcm.util.TableSorter) table.getModel()).getTableModel();
      Field outer = model.getClass().getDeclaredField("this$0");
      outer.setAccessible(true);
      Field list = lcm.spy.Spy.class.getDeclaredField("channelList");
      list.setAccessible(true);
      List<?> channels = (List<?>) list.get(outer.get(model));
      for (int row = 0; row < table.getRowCount(); ++row) {
        Object name = table.getValueAt(row, 0);
        for (Object entry : channels) {
          lcm.spy.ChannelData channel = (lcm.spy.ChannelData) entry;
          if (!channel.name.equals(name) || channel.last == null) continue;
          Object utime = channel.last.getClass().getField("utime").get(channel.last);
          lines.append(name).append(' ').append(table.getValueAt(row, 1)).append(' ');
          lines.append(channel.last.getClass().getName()).append(' ').append(utime).append('\n');
        }
      }
    } catch (ReflectiveOperationException error) {
      throw new IllegalStateException(error);
    }
  }
}
