const markers = {o: "circle", s: "square", D: "diamond", p: "hex", h: "star", "^": "triangle",
  v: "inverted_triangle", "<": "circle_dot", ">": "square_dot", x: "x", X: "square_x",
  P: "square_cross", "*": "star", ".": "circle", _: "dash"};
const dashes = {"-": "solid", "--": [6, 4], "-.": "dashdot", ":": "dotted"};
const unpack = (text) => Array.from(
  new Float32Array(Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0)).buffer));
const NOWHERE = "AADAfw==";  // NaN

function drawItem(plot, item, hovered) {  // gives its renderers
  const {color} = item, name = item.label || " ";
  if (item.kind === "text") {
    const [x, y] = item.at, [x_offset, y_offset] = item.shift;
    const look = {text_font_size: "11px", text_color: color, text_align: item.align, x_offset, y_offset};
    plot.add_layout(new Bokeh.Label({x, y, text: item.text, ...look}));
    return [];
  }
  if (item.kind === "bars") {
    const [left, right, bottom, top] = item.corners.map(unpack);
    return [plot.quad({left, right, bottom, top, color})];
  }
  const data = {x: unpack(item.x), y: unpack(item.y)};
  if (item.notes) data.note = item.notes;
  const source = new Bokeh.ColumnDataSource({data}), x = {field: "x"}, y = {field: "y"}, drawn = [];
  const look = {source, name, line_color: color};
  if (item.style) {
    drawn.push(plot.line({x, y, ...look, line_dash: dashes[item.style], line_width: item.width}));
  }
  if (item.marker) {
    const fill_color = item.hollow ? "white" : color;
    drawn.push(plot.scatter({x, y, ...look, marker: markers[item.marker], fill_color, size: item.size}));
  }
  hovered.push(...drawn);
  return drawn;
}

function dressAxis(axis, {label, marks}) {
  axis.axis_label = label || null;
  axis.axis_label_text_font_style = "normal";
  axis.axis_label_text_font_size = "12px";
  axis.minor_tick_line_color = null;
  if (marks.length) {
    axis.ticker = new Bokeh.FixedTicker({ticks: marks.map(([place]) => place)});
    axis.major_label_overrides = new Map(marks);
  }
}

function drawPanel(panel, range) {
  const kind = (axis) => (axis.log ? "log" : "linear");
  const plot = Bokeh.Plotting.figure({
    height: panel.height + 60, x_axis_type: kind(panel.x), y_axis_type: kind(panel.y),
    x_range: range("x", panel.x.ends), y_range: range("y", panel.y.ends),
    tools: "box_zoom,pan,wheel_zoom,reset,save", title: panel.title || null,
    sizing_mode: "stretch_width",
  });
  plot.toolbar.logo = null;
  plot.toolbar.active_drag = plot.toolbar.tools.find((tool) => tool instanceof Bokeh.BoxZoomTool);
  plot.xaxes.forEach((axis) => dressAxis(axis, panel.x));
  plot.yaxes.forEach((axis) => dressAxis(axis, panel.y));
  const hovered = [], named = [];
  for (const item of panel.items) {
    for (const one of drawItem(plot, item, hovered)) named.push([item.names ?? [], one]);
  }
  const word = (axis, other) => (axis.label || other).replace(/\s+/g, " ");
  const tooltips = [[word(panel.x, "x"), "@x"], [word(panel.y, "y"), "@y"]];
  if (hovered.some((one) => one.name.trim())) tooltips.unshift(["", "$name"]);
  if (panel.items.some((item) => item.notes)) tooltips.push(["", "@note"]);
  if (hovered.length) plot.add_tools(new Bokeh.HoverTool({renderers: hovered, tooltips, visible: false}));
  return [plot, named];
}

function drawLegend(plot, samples, named) {
  const items = samples.map((sample) => {
    const alike = named.filter(([names]) => names.includes(sample.label)).map(([, one]) => one);
    // the mark beside a name is that of its first renderer, which must be in this plot
    const own = drawItem(plot, {...sample, x: NOWHERE, y: NOWHERE, corners: Array(4).fill(NOWHERE)}, []);
    return new Bokeh.LegendItem({label: {value: sample.label}, renderers: [...own, ...alike]});
  });
  const ncols = samples.some((sample) => sample.label.length > 25) ? 3 : 4;
  const look = {orientation: "horizontal", click_policy: "hide", border_line_color: null};
  plot.add_layout(new Bokeh.Legend({items, ncols, ...look}), "above");
  plot.height += 30 * Math.ceil(items.length / ncols);
}

function drawDetails(plot, labels, details) {  // ring points; a click on one fills small plots
  const sources = details[0].lines.map(() => new Bokeh.ColumnDataSource({data: {x: [], y: []}}));
  const small = sources.map((source, k) => {
    const [x_axis_label, y_axis_label] = labels[k];
    const look = {height: 240, sizing_mode: "stretch_width", toolbar_location: null, title: " "};
    const one = Bokeh.Plotting.figure({...look, x_axis_label, y_axis_label});
    one.axes.forEach((axis) => { axis.axis_label_text_font_style = "normal"; });
    one.line({x: {field: "x"}, y: {field: "y"}, source, line_width: 2});
    return one;
  });
  const show = ({title, lines}) => {
    small[0].title.text = title;
    lines.forEach(({x, y}, k) => { sources[k].data = {x: unpack(x), y: unpack(y)}; });
  };
  const [x, y] = [0, 1].map((k) => details.map(({at}) => at[k]));
  const points = new Bokeh.ColumnDataSource({data: {x, y}});
  const ring = {size: 12, fill_alpha: 0, line_color: "#1d2125", line_alpha: 0.6};
  const rings = plot.scatter({x: {field: "x"}, y: {field: "y"}, source: points, ...ring});
  plot.add_tools(new Bokeh.TapTool({renderers: [rings]}));
  points.selected.properties.indices.change.connect(() => {
    const [k] = points.selected.indices;
    if (k !== undefined) show(details[k]);
  });
  show(details[0]);
  return new Bokeh.Row({children: small, sizing_mode: "stretch_width"});
}

async function drawChart(chart, place) {
  const shared = {};
  const range = (axis, [start, end]) => {
    const own = new Bokeh.Range1d({start, end});
    return chart.share.includes(axis) ? (shared[axis] ??= own) : own;
  };
  const pairs = chart.panels.map((panel) => drawPanel(panel, range));
  const named = pairs.flatMap(([, own]) => own), [[first]] = pairs;
  if (chart.legend.length) drawLegend(first, chart.legend, named);
  const details = chart.details.length
    ? [drawDetails(first, chart.detail_labels, chart.details)] : [];
  const grid = Bokeh.Plotting.gridplot([pairs.map(([plot]) => plot)], {sizing_mode: "stretch_width"});
  grid.children = pairs.map(([plot], k) => [plot, ...chart.panels[k].place]);
  await Bokeh.Plotting.show(details.length
    ? new Bokeh.Column({children: [grid, ...details], sizing_mode: "stretch_width"}) : grid, place);
}
