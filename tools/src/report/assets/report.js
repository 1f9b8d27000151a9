"use strict";
(() => {
  const page = JSON.parse(document.getElementById("data").textContent);
  const root = document.getElementById("report");
  // Colors that the color-blind can distinguish (Okabe and Ito), then the same colors dashed.
  const kColors = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f6fc9", "#8c8c8c"];
  const kCorrect = "#1a9641", kIncorrect = "#d7191c", kMissed = "#f39c12", kStored = "#3b76b5", kPath = "#a9b0b8";
  const kMetrics = [["average_precision", "AP"], ["f1_max", "F1 max"],
    ["max_recall_at_precision_1", "recall, 100 % prec."], ["recall_at_1", "recall@1"]];
  const charts = [], kWidest = innerWidth / 320;  // aspect on a phone

  // Text is always set as text, so data cannot become markup.
  function el(tag, attributes = {}, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name === "on") for (const [event, f] of Object.entries(value)) element.addEventListener(event, f);
      else if (value !== undefined && value !== "") element.setAttribute(name, value);
    }
    for (const child of children.flat()) if (child !== null && child !== undefined) element.append(child);
    return element;
  }
  const number = (value, digits = 3) => Number.isFinite(value) ? value.toFixed(digits) : "";
  const list = value => value || [];
  const extent = values => values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
  function table(header, rows) {
    const isNumber = header.map(([, kind]) => kind === "n");
    return el("div", { class: "scroll" }, el("table", {},
      el("thead", {}, el("tr", {}, header.map(([name], i) => el("th", { class: isNumber[i] ? "n" : "" }, name)))),
      el("tbody", {}, rows.map(row => el("tr", {}, row.map((cell, i) => {
        const best = cell && cell.best;
        return el("td", { class: [isNumber[i] ? "n" : "", best ? "best" : ""].join(" ").trim(), "data-label": header[i][0] },
          cell && cell.text !== undefined ? cell.text : cell);
      }))))));
  }
  function metric(metrics, key) {
    const text = number(metrics[key]);
    const interval = metrics[key + "_ci"];
    return Array.isArray(interval) && text ? `${text} [${number(interval[0])}, ${number(interval[1])}]` : text;
  }
  const commandBox = command => command ? el("details", {}, el("summary", { class: "soft" }, "command"), el("pre", {}, el("code", {}, command))) : null;

  const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  function theme(options) {
    const text = css("--soft"), line = css("--line");
    for (const axis of Object.values(options.scales)) {
      axis.ticks = { ...axis.ticks, color: text };
      axis.grid = { ...axis.grid, color: line };
      axis.title = { ...axis.title, color: text };
    }
  }
  function axis(title, more = {}) {
    return { type: "linear", title: { display: true, text: title }, ...more, ticks: { includeBounds: false, ...more.ticks } };
  }
  function save(chart, name) {
    const picture = el("canvas", { width: chart.width * 2, height: chart.height * 2 }), context = picture.getContext("2d");
    context.fillStyle = css("--paper");
    context.fillRect(0, 0, picture.width, picture.height);
    context.drawImage(chart.canvas, 0, 0, picture.width, picture.height);
    el("a", { href: picture.toDataURL("image/png"), download: name.replace(/[^\w.-]+/g, "_") + ".png" }).click();
  }
  function plot(name, config, aspect) {
    const canvas = el("canvas", { role: "img", "aria-label": name });
    const box = el("div", { class: "plot" }, canvas);
    config.options = { animation: false, responsive: true, maintainAspectRatio: true, aspectRatio: Math.min(aspect, kWidest),
      parsing: false, normalized: true, interaction: { mode: "nearest", intersect: false, axis: "xy" }, ...config.options };
    config.options.plugins = { legend: { display: false }, ...config.options.plugins };
    theme(config.options);
    const legend = el("div", { class: "legend" });
    const start = () => {
      const chart = new Chart(canvas, config);
      charts.push(chart);
      config.data.datasets.forEach((set, i) => {
        if (!set.label) return;
        const button = el("button", { type: "button", "aria-pressed": "true", title: "hide or show", "data-points": String(set.data.length),
          on: { click: () => {
            const show = !chart.isDatasetVisible(i);
            for (let j = 0; j < config.data.datasets.length; ++j)
              if (j === i || config.data.datasets[j].belongsTo === set.label) chart.setDatasetVisibility(j, show);
            button.setAttribute("aria-pressed", String(show));
            chart.update();
          } } }, el("span", { class: "swatch", style: `background:${set.borderColor}` }), set.legend || set.label);
        legend.append(button);
      });
      legend.append(el("button", { type: "button", class: "save", title: "save this figure as a PNG file", on: { click: () => save(chart, name) } }, "PNG"));
      canvas.dataset.drawn = String(chart.getVisibleDatasetCount());
    };
    const holder = el("div", {}, box, legend);
    requestAnimationFrame(start);
    return holder;
  }

  function prDataset(label, curve, metrics, index) {
    const recall = list(curve && curve.recall), precision = list(curve && curve.precision), threshold = list(curve && curve.threshold);
    const data = recall.map((r, i) => ({ x: r, y: precision[i], t: threshold[i] }));
    if (data.length) data.unshift({ x: 0, y: data[0].y, t: data[0].t });
    const color = kColors[index % kColors.length];
    return { label, legend: `${label} (AP ${number(metrics && metrics.average_precision) || "-"})`, data, showLine: true, borderColor: color,
      backgroundColor: color, borderWidth: 2, borderDash: index >= kColors.length ? [6, 3] : [], pointRadius: 0, pointHitRadius: 6, pointHoverRadius: 5 };
  }
  function prPlot(name, datasets, aspect = 1.35) {
    return plot(name, { type: "scatter", data: { datasets }, options: {
      scales: { x: axis("recall", { min: 0, max: 1 }), y: axis("precision", { min: 0, max: 1.02, ticks: { stepSize: .2 } }) },
      plugins: { tooltip: { callbacks: { label: item => [item.dataset.label,
        `threshold ${number(item.raw.t, 4)}`, `precision ${number(item.raw.y)}, recall ${number(item.raw.x)}`] } } },
    } }, aspect);
  }

  const panelsOf = entry => {
    const panels = new Map();
    list(entry.runs).forEach(run => {
      if (run.state !== "done") return;
      if (!panels.has(run.panel)) panels.set(run.panel, []);
      panels.get(run.panel).push({ run, curve: list((page.runs[run.run] || {}).tasks).map(task => task.curve)[0] });
    });
    return panels;
  };
  function panelPlot(entry, panel, items) {
    const name = `${entry.title}, ${panel}`;
    return prPlot(name, items.map((item, i) => prDataset(item.run.label, item.curve, item.run.metrics, i)));
  }
  function metricRows(items, first) {
    const best = {};
    for (const [key] of kMetrics) best[key] = Math.max(...items.map(item => (item.run.metrics || {})[key] ?? -1));
    return items.map(item => [...first(item), ...kMetrics.map(([key]) => {
      const metrics = item.run.metrics || {};
      // Only the first metric has its interval, because all columns must fit; the others are with the commands.
      return { text: key === kMetrics[0][0] ? metric(metrics, key) : number(metrics[key]), best: items.length > 1 && metrics[key] !== undefined && metrics[key] === best[key] };
    })]);
  }
  function comparisonTable(entry, items) {
    if (!items.some(item => item.run.method))
      return table([["curve"], ...kMetrics.map(([, title]) => [title, "n"])], metricRows(items, item => [item.run.label]));
    return table([["method"], ...kMetrics.map(([, title]) => [title, "n"]), ["dimensions", "n"], ["training data"], ["parameters"],
      ["frames/s here", "n"], ["frames/s in the paper", "n"]],
      metricRows(items, item => [item.run.label]).map((row, i) => {
        const method = items[i].run.method || {};
        return [...row, String(items[i].run.descriptor_dimension ?? ""), method.needs_training ? "yes" : "no", method.parameters || "",
          number(items[i].run.frames_per_second, 1), number(method.paper_frames_per_second, 1)];
      }));
  }
  function overview() {
    const choices = [];
    for (const entry of list(page.experiments)) for (const [panel, items] of panelsOf(entry)) choices.push({ entry, panel, items });
    const plain = list(page.runs).filter(run => !tasksOf(run).length);
    for (const run of plain) if (!choices.length || !list(page.experiments).length) {
      const items = list(run.tasks).map(task => ({ run: { label: task.metrics.protocol, metrics: task.metrics }, curve: task.curve }));
      choices.push({ entry: { title: run.title, name: "" }, panel: "", items });
    }
    if (plain.length > 1 && !list(page.experiments).length) {
      const items = plain.flatMap(run => list(run.tasks).map(task => ({ run: { label: `${run.title}, ${task.metrics.protocol}`, metrics: task.metrics }, curve: task.curve })));
      choices.unshift({ entry: { title: "All runs", name: "" }, panel: "", items });
    }
    if (!choices.length) return el("p", {}, "No run was finished.");
    const content = el("div", { class: "first" });
    const show = choice => {
      content.classList.toggle("wide", choice.items.some(item => item.run.method));  // more columns
      content.replaceChildren(el("div", { class: "card" }, panelPlot(choice.entry, choice.panel, choice.items)),
        el("div", { class: "card" }, comparisonTable(choice.entry, choice.items), choice.entry.simulated ? el("p", { class: "note" }, "Simulated data.") : null));
    };
    let first = choices.findIndex(choice => choice.entry.name === "comparison");
    if (first < 0) first = 0;
    const select = el("select", { "aria-label": "what is compared", on: { change: () => show(choices[select.value]) } },
      choices.map((choice, i) => el("option", { value: String(i), ...(i === first ? { selected: "selected" } : {}) },
        [choice.entry.title, choice.panel].filter(Boolean).join(": "))));
    show(choices[first]);
    return el("section", { id: "overview" }, el("p", {}, select, " ", el("span", { class: "soft hint" }, "Point at a curve for its threshold; click a legend entry to hide it.")), content);
  }
  function experimentSection(experiment) {
    const panels = panelsOf(experiment);
    const done = [...panels.values()].flat();
    const reasons = new Map();
    for (const run of list(experiment.runs)) if (run.state !== "done") {
      const key = `${run.state}: ${run.reason || ""}`;
      if (!reasons.has(key)) reasons.set(key, []);
      reasons.get(key).push(`${run.panel} ${run.label}`);
    }
    return el("section", { id: experiment.name }, el("h2", {}, experiment.title), el("p", {}, experiment.question),
      el("p", { class: "soft" }, "The paper: " + experiment.paper), list(experiment.notes).map(note => el("p", { class: "note" }, note)),
      panels.size < 2 && list(page.experiments).length < 2 ? null : el("div", { class: "grid" }, [...panels].map(([panel, items]) => el("div", { class: "card" }, el("h3", {}, panel), panelPlot(experiment, panel, items)))),
      list(experiment.claims).length ? table([["statement"], ["sequence"], ["AP", "n"], ["against", "n"], ["result"]],
        experiment.claims.map(claim => [claim.text, claim.panel, number(claim.better_average_precision), number(claim.worse_average_precision),
          claim.undecided ? el("span", { class: "soft", title: "each within the other's 95 % interval" }, "undecided")
            : el("span", { class: claim.holds ? "good" : "bad" }, claim.holds ? "holds" : "does not hold")])) : null,
      done.length ? el("details", {}, el("summary", {}, `Numbers and commands (${done.length} curves)`),
        table([["sequence"], ["curve"], ...kMetrics.map(([, title]) => [title, "n"]), ["feature", "n"], ["reduced to", "n"], ["frames/s", "n"], ["command"]],
          done.map(item => [item.run.panel, item.run.label, ...kMetrics.map(([key]) => metric(item.run.metrics || {}, key)),
            String(item.run.feature_dimension ?? ""), String(item.run.descriptor_dimension ?? ""), number(item.run.frames_per_second, 1),
            el("code", {}, item.run.command || "")]))) : null,
      reasons.size ? el("details", {}, el("summary", { class: "warn" }, `Not run (${[...reasons.values()].flat().length})`),
        el("ul", {}, [...reasons].map(([reason, labels]) => el("li", {}, `${reason} (${labels.join("; ")})`)))) : null,
      commandBox(experiment.command));
  }

  const accepted = flags => flags & 1, correct = flags => flags & 2, positive = flags => flags & 4, ignored = flags => flags & 8, turned = flags => flags & 16;
  const outcome = flags => ignored(flags) ? "ignored" : accepted(flags) ? (correct(flags) ? "correct" : "incorrect") : positive(flags) ? "missed" : "rejected";
  /** Run that holds frame, x and z. */
  const scansOf = run => run.scans_of === undefined ? run : page.runs[run.scans_of];
  /** Best first. */
  function matchesOf(task, i) {
    const n = list(task.match).length / list(task.scan).length;
    return list(task.match).slice(i * n, (i + 1) * n).map((scan, j) => ({ scan, similarity: list(task.similarity)[i * n + j] })).filter(match => match.scan >= 0);
  }
  /** Breaks between scans much farther apart than the others, because these are not consecutive. */
  function pathOf(xs, zs) {
    const steps = xs.slice(1).map((x, i) => Math.hypot(x - xs[i], zs[i + 1] - zs[i]));
    const longest = Math.max(10, 5 * [...steps].sort((a, b) => a - b)[steps.length >> 1] || 0);
    return xs.flatMap((x, i) => i > 0 && steps[i - 1] > longest ? [{ x: NaN, y: NaN }, { x, y: zs[i] }] : [{ x, y: zs[i] }]);
  }
  const dots = (label, data, color, radius) => ({ label, legend: `${label} (${data.length})`, data, borderColor: color, backgroundColor: color,
    pointRadius: radius, pointHitRadius: 4, borderWidth: 0 });
  // Parsed, because Chart.js takes other data as sorted and leaves out lines.
  const joined = (belongsTo, data, color, width = 1) => ({ belongsTo, data, parsing: true, showLine: true, spanGaps: false, borderColor: color, borderWidth: width, pointRadius: 0, pointHitRadius: 0 });
  /** Equal scales. Only points with `scan` have a tooltip. */
  function groundPlot(name, xs, zs, datasets, label, display = true) {
    const [x0, x1] = extent(xs), [z0, z1] = extent(zs), margin = .04 * Math.max(x1 - x0, z1 - z0, 10);
    const width = x1 - x0 + 2 * margin, height = z1 - z0 + 2 * margin, aspect = Math.min(Math.max(width / height, 1), 2.5, kWidest);
    const grow = Math.max(0, aspect * height - width) / 2, rise = Math.max(0, width / aspect - height) / 2;
    return plot(name, { type: "scatter", data: { datasets }, options: {
      scales: { x: axis("x, right [m]", { display, min: x0 - margin - grow, max: x1 + margin + grow }), y: axis("z, forward [m]", { display, min: z0 - margin - rise, max: z1 + margin + rise }) },
      plugins: { tooltip: { filter: item => item.raw.scan !== undefined, callbacks: { label } } } } }, aspect);
  }
  /** Links between near scans stand upright. kinds: [label, color, links]; a link: a scan, and its match or the match's position in an earlier drive. */
  function raisedPlot(name, xs, zs, kinds) {
    const size = Math.max(...[xs, zs].map(extent).map(([low, high]) => high - low), 1), [x0] = extent(xs), [z0] = extent(zs);
    const at = (x, z, time) => ({ x: .87 * (x - x0) - .5 * (z - z0), y: .25 * (x - x0) + .43 * (z - z0) + .5 * size * time });
    const path = xs.map((x, i) => at(x, zs[i], i / xs.length)), end = to => typeof to === "number" ? path[to] : at(to.x, to.y, -.2);
    const ends = kinds.flatMap(([, , links]) => links.map(([, to]) => end(to))), all = [...path, ...ends];
    return [groundPlot(name, all.map(p => p.x), all.map(p => p.y), [
      ...kinds.map(([label, color, links]) => dots(label, links.map(([from]) => path[from]), color, 2)),
      ...kinds.map(([label, color, links]) => joined(label, links.flatMap(([from, to]) => [path[from], end(to), { x: NaN, y: NaN }]), color + "80")),
      joined("", pathOf(path.map(p => p.x), path.map(p => p.y)), kPath, 1.6)], () => "", false), el("p", { class: "soft" }, "The same from the side, raised by time.")];
  }
  function mapPlot(run, task) {
    const drive = scansOf(run), frame = list(drive.frame), xs = list(drive.x), zs = list(drive.z);
    if (!xs.length) return el("p", { class: "soft" }, "Places are known by name: there is no map.");
    const at = scan => ({ x: xs[scan], y: zs[scan], scan });
    const points = { correct: [], incorrect: [], missed: [] }, lines = { correct: [], incorrect: [] }, links = { correct: [], incorrect: [] };
    list(task.scan).forEach((scan, i) => {
      const kind = outcome(list(task.flags)[i]), match = (matchesOf(task, i)[0] || { scan: -1 }).scan;
      if (!points[kind]) return;
      points[kind].push({ ...at(scan), match, score: list(task.score)[i] });
      if (!lines[kind] || match < 0) return;
      lines[kind].push(at(scan), at(match), { x: NaN, y: NaN });
      links[kind].push([scan, match]);
    });
    const shown = list(task.shown).flatMap(query => [list(task.scan)[query.query || 0], ...matchesOf(task, query.query || 0).slice(0, 1).map(match => match.scan)]).map(at);
    const rings = { ...dots("shown below", shown, "#7f6fc9", 6), legend: `shown below (${list(task.shown).length})`, backgroundColor: "transparent", borderWidth: 2, pointHitRadius: 0 };
    const name = `map, ${run.title}, ${task.metrics.protocol}`, card = (...children) => el("div", { class: "card" }, ...children);
    return el("div", { class: "grid" }, card(groundPlot(name, xs, zs, [
      ...(shown.length ? [rings] : []),
      dots("correct", points.correct, kCorrect, 2.5), dots("incorrect", points.incorrect, kIncorrect, 2.5), dots("missed", points.missed, kMissed, 2.5),
      dots("stored", list(task.stored).map(at), kStored, 1.5), dots("scans", frame.map((_, i) => at(i)), kPath, 1.2),
      joined("correct", lines.correct, kCorrect + "80"), joined("incorrect", lines.incorrect, kIncorrect + "80"), joined("scans", pathOf(xs, zs), kPath + "80", 1.4)], item => {
        const raw = item.raw, text = [`${item.dataset.label || ""} ${frame[raw.scan]}`];
        if (raw.match >= 0) text.push(`best match ${frame[raw.match]}, ${number(Math.hypot(xs[raw.scan] - xs[raw.match], zs[raw.scan] - zs[raw.match]), 1)} m away`, `score ${number(raw.score, 4)}`);
        return text;
      })), card(...raisedPlot(`raised ${name}`, xs, zs, [["correct", kCorrect, links.correct], ["incorrect", kIncorrect, links.incorrect]])));
  }
  /** Bins start at `low` and are `width` wide. Fractions, because correct matches are often too few to be visible as counts. */
  function histogram(name, low, width, series, threshold, title) {
    const datasets = series.map(({ label, color, counts }) => {
      const total = counts.reduce((a, b) => a + b, 0);
      return { label, legend: `${label} (${total})`, borderColor: color, backgroundColor: color + "99", barPercentage: 1, categoryPercentage: 1, grouped: false,
        data: counts.map((count, i) => ({ x: low + (i + .5) * width, y: total ? 100 * count / total : 0 })) };
    });
    const most = Math.max(...datasets.flatMap(set => set.data.map(bar => bar.y)), 1);
    if (Number.isFinite(threshold)) datasets.push({ type: "line", label: "threshold", legend: `threshold ${number(threshold)}`, borderColor: css("--text"),
      borderWidth: 1.6, borderDash: [5, 4], pointRadius: 0, data: [{ x: threshold, y: 0 }, { x: threshold, y: most }] });
    return plot(name, { type: "bar", data: { datasets }, options: {
      scales: { x: axis(title, { min: low, max: low + series[0].counts.length * width, offset: false, grid: { offset: false } }), y: axis("fraction of each class [%]", { beginAtZero: true }) },
      plugins: { tooltip: { callbacks: { title: () => "", label: item => `${item.dataset.label}: ${number(item.raw.y, 1)} % at ${number(item.raw.x, 3)}` } } } } }, 1.6);
  }
  function scorePlot(run, task) {
    const name = `scores, ${run.title}, ${task.metrics.protocol}`, threshold = task.metrics.f1_max_threshold, pairs = task.histogram;
    if (pairs) return histogram(name, pairs.low || 0, pairs.width, [{ label: "incorrect pair", color: kIncorrect, counts: list(pairs.of_incorrect) },
      { label: "correct pair", color: kCorrect, counts: list(pairs.of_correct) }], threshold, "similarity of the pair");
    const bins = 50, scores = list(task.score), counted = scores.map((_, i) => i).filter(i => !ignored(list(task.flags)[i]));
    if (!counted.length) return el("p", { class: "soft" }, "nothing to show");
    const low = counted.reduce((a, i) => Math.min(a, scores[i]), Infinity), high = counted.reduce((a, i) => Math.max(a, scores[i]), low + 1e-3), width = (high - low) / bins;
    const counts = wanted => {
      const counts = new Array(bins).fill(0);
      for (const i of counted) if (Boolean(correct(list(task.flags)[i])) === wanted) ++counts[Math.min(bins - 1, Math.floor((scores[i] - low) / width))];
      return counts;
    };
    return histogram(name, low, width, [{ label: "best match is incorrect", color: kIncorrect, counts: counts(false) },
      { label: "best match is correct", color: kCorrect, counts: counts(true) }], threshold, "score of the best match");
  }
  function alignmentPlots(run) {
    const frame = list(scansOf(run).frame), mirrored = list(run.mirrored);
    const ratio = list(run.eigenvalue_ratio).map(Number), t11 = list(run.abs_t11).map(Number);  // "NaN" for skipped scans
    if (!ratio.length) return [el("p", { class: "soft" }, "Camera images are not aligned.")];
    const over = (values, title, options) => plot(title, { type: "scatter", data: { datasets: [{ label: title, data: values.map((y, i) => ({ x: frame[i], y, yaw: list(run.yaw_deg)[i] })),
      borderColor: kColors[0], backgroundColor: kColors[0] + "99", pointRadius: 1.8 }] }, options: {
      scales: { x: axis("frame"), y: axis(title, options) },
      plugins: { tooltip: { callbacks: { label: item => [`frame ${item.raw.x}: ${number(item.raw.y, 2)}`, `yaw of x' ${number(item.raw.yaw, 1)} deg`] } } } } }, 2.2);
    const unsure = ratio.filter(value => value < 1.1).length, flips = t11.filter(value => value < .1).length;
    return [el("p", {}, `Alignment ${run.info.align || ""}. Of ${ratio.length} scans ${unsure} have an eigenvalue ratio l1/l2 below 1.1 (the direction is not determined), ` +
      `${flips} have |t11| below 0.1 (the sign may flip), and for ${mirrored.length} the wanted signs would need a mirror.`),
      el("div", { class: "grid" }, el("div", { class: "card" }, over(ratio, "eigenvalue ratio l1 / l2", { min: 1 })), el("div", { class: "card" }, over(t11, "|t11|", { min: 0, max: 1 })))];
  }
  function browser(run, task) {
    const { frame, x, z } = scansOf(run);
    const image = key => key && page.images && page.images[key];
    const line = (caption, key, className) => el("figure", {}, image(key) ? el("img", { src: image(key), alt: caption, loading: "lazy" }) : el("p", { class: "soft" }, "(no range image)"), el("figcaption", { class: className }, caption));
    return list(task.shown).map(shown => {
      const kind = shown.kind, query = shown.query || 0, scan = task.scan[query];
      const away = match => list(x).length ? `, ${number(Math.hypot(x[scan] - x[match], z[scan] - z[match]), 1)} m away` : "";
      return el("div", { class: "shown" }, el("h3", { class: kind === "correct" ? "good" : kind === "incorrect" ? "bad" : "warn" },
        `${kind}: query ${frame[scan]}, score ${number(task.score[query], 4)}${turned(task.flags[query]) ? " (alignment case 2)" : ""}`),
        line(`query ${frame[scan]}`, list(shown.images)[0], "soft"),
        matchesOf(task, query).map((match, i) => line(`${i + 1}. scan ${frame[match.scan]}: similarity ${number(match.similarity, 4)}${away(match.scan)}`, list(shown.images)[i + 1], "")));
    });
  }
  function runContent(run) {
    const info = run.info || {}, stages = list(info.stages);
    return [
      ...list(run.tasks).filter(task => task.metrics.self === undefined).map(task => [
        el("h3", {}, task.metrics.protocol), el("p", { class: "soft" }, `${task.metrics.population || ""}; alignment of the queries: ${task.metrics.query_case || "?"}`),
        table([["", ""], ...kMetrics.map(([, title]) => [title, "n"]), ["queries", "n"], ["with a correct match", "n"], ["correct match"]],
          [["", ...kMetrics.map(([key]) => metric(task.metrics, key)), String(task.metrics.n_queries ?? 0), String(task.metrics.n_positives ?? 0), `${task.metrics.distance} < ${task.metrics.radius_m} m, exclusion ${task.metrics.exclusion}`]]),
        el("div", { class: "grid" }, el("div", { class: "card" }, prPlot(`precision and recall, ${run.title}, ${task.metrics.protocol}`, [prDataset(task.metrics.protocol, task.curve, task.metrics, 0)])),
          list(task.scan).length || task.histogram ? el("div", { class: "card" }, scorePlot(run, task)) : null),
        list(task.scan).length ? mapPlot(run, task) : null,
        list(task.shown).length ? el("details", { open: "open" }, el("summary", {}, "Queries: errors with the highest scores, misses with the lowest, and correct ones"), browser(run, task)) : null]).flat(),
      ...(list(scansOf(run).frame).length ? [el("h3", {}, "Alignment"), ...alignmentPlots(run)] : []),
      el("h3", {}, "Time and memory"),
      stages.length ? table([["stage"], ["times", "n"], ["median ms", "n"], ["95th percentile ms", "n"], ["total s", "n"]],
        stages.map(stage => [stage.name, String(stage.count || 0), number(stage.median_ms || 0, 2), number(stage.p95_ms || 0, 2), number((stage.total_ms || 0) / 1000, 1)])) : el("p", { class: "soft" }, "The features came from the cache; their times are with the run that made them."),
      el("p", {}, `${info.frames_per_second ? `${number(info.frames_per_second, 1)} frames/s of one thread's processor time, from points in memory to the feature (${info.threads} threads shared the machine). ` : ""}Peak memory ${number((info.peak_resident_bytes || 0) / 1e6, 0)} MB.`),
      el("h3", {}, "Configuration"),
      table([["setting"], ["value"]], [...Object.entries(run.configuration || {}).sort(),
        ["version", info.version || ""], ["scans", String(info.scans || 0)], ["feature", `${info.feature || ""}, ${info.feature_dimension || 0} dimensions`], ["PCA", info.pca_fit || ""],
        ["weights (sha1)", info.weights_sha1 || ""], ["range image", `${info.image_width} x ${info.image_height}, ${info.elevation_top_deg} to ${info.elevation_bottom_deg} degrees, ${info.max_range_m} m`]]),
      info.command ? el("pre", {}, el("code", {}, info.command)) : null,
    ];
  }
  function runSection(run, index, open) {
    const body = el("div", {});
    let filled = false;
    const fill = () => { if (!filled) { filled = true; body.append(...runContent(run).flat(3).filter(Boolean)); } };
    const warning = run.info && run.info.model && !run.info.trained ? el("span", { class: "warn" }, " UNTRAINED: random weights, results do not measure accuracy") : null;
    const details = el("details", { class: "run", id: `run${index + 1}`, on: { toggle: () => details.open && fill() } }, el("summary", {}, run.title, warning), body);
    if (open) { details.open = true; fill(); }
    return details;
  }

  function loopSection(loops, index) {
    const lines = list(loops.lines), name = loops.title, own = line => (line.match_drive || "") === (line.drive || "");
    const isLoop = line => line.accepted, apart = line => line.position && line.match_position &&
      Math.hypot(...["x", "y", "z"].map(axis => (line.position[axis] || 0) - (line.match_position[axis] || 0)));
    const found = lines.filter(isLoop), drives = [...new Set(found.map(line => line.match_drive || ""))].sort();
    const rejected = lines.filter(line => line.registered && !line.accepted);
    const middle = values => values.length ? [...values].sort((a, b) => a - b)[values.length >> 1] : NaN;
    const distances = found.filter(own).map(apart).filter(Number.isFinite);
    const text = line => [`scan ${line.frame}`, ...(line.match_frame === undefined ? [] : [`like ${line.match_drive || ""} ${line.match_frame}`, `score ${number(line.score, 4)}`,
      ...(line.yaw_deg === undefined ? [] : [`relative yaw ${number(line.yaw_deg, 1)} degrees`]), ...(Number.isFinite(apart(line)) ? [`${number(apart(line), 1)} m from the match by the poses`] : [])])];
    const label = item => text(lines[item.raw.scan]);
    const positions = new Map(lines.map((line, i) => [line, i])), point = (line, x, y) => ({ x, y, scan: positions.get(line) });
    const placed = lines.filter(line => line.position), along = axis => placed.map(line => line.position[axis] || 0);
    const range = axis => { const [low, high] = extent(along(axis)); return high - low; };
    const ahead = range("z") > range("y") ? "z" : "y", xs = along("x"), zs = along(ahead);  // z: the axes of KITTI's camera
    const ground = line => point(line, line.position.x || 0, line.position[ahead] || 0), place = line => ({ x: line.match_position.x || 0, y: line.match_position[ahead] || 0 });
    const onMap = found.filter(line => line.position && line.match_position);
    const order = new Map(placed.map((line, i) => [line.frame, i]));
    const links = onMap.map(line => [order.get(line.frame), (own(line) ? order.get(Number(line.match_frame)) : undefined) ?? place(line)]);
    const matrix = plot(`matches, ${name}`, { type: "scatter", data: { datasets: drives.map((drive, i) =>
      dots(found.some(line => own(line) && (line.match_drive || "") === drive) ? "place of this drive" : `place of ${drive}`, found.filter(line => (line.match_drive || "") === drive).map(line => point(line, line.frame, Number(line.match_frame))), kColors[i % kColors.length], 2.5)) },
      options: { scales: { x: axis("frame", { min: 0 }), y: axis("matched frame", { min: 0 }) }, plugins: { tooltip: { callbacks: { label } } } } }, 1.35);
    const asked = lines.filter(line => line.score !== undefined), limits = asked.filter(line => line.threshold !== undefined);
    const scores = plot(`scores, ${name}`, { type: "scatter", data: { datasets: [dots("accepted", found.map(line => point(line, line.frame, line.score)), kCorrect, 2.2),
      ...(rejected.length ? [dots("rejected after registration", rejected.map(line => point(line, line.frame, line.score)), kIncorrect, 2.5)] : []),
      dots("not accepted", asked.filter(line => !isLoop(line) && !line.registered).map(line => point(line, line.frame, line.score)), kPath, 1.6),
      ...(limits.length ? [{ ...joined("", [limits[0], limits[limits.length - 1]].map(line => ({ x: line.frame, y: line.threshold })), css("--text"), 1.6), borderDash: [5, 4],
        label: "threshold", legend: `threshold ${number(limits[0].threshold)}` }] : [])] },
      options: { scales: { x: axis("frame"), y: axis("score") }, plugins: { tooltip: { callbacks: { label } } } } }, 1.35);
    return el("section", { id: `loops${index + 1}` }, el("h2", {}, `Loops: ${name}`),
      table([["scans in the file", "n"], ["loops", "n"], ["rejected after registration", "n"], ["median score", "n"], ["median distance to the match [m]", "n"], ["largest [m]", "n"]],
        [[String(lines.length), String(found.length), String(rejected.length), number(middle(found.map(line => line.score))), number(middle(distances), 2), number(distances.length ? distances.reduce((a, b) => Math.max(a, b)) : NaN, 2)]]),
      placed.length ? el("div", { class: "grid" }, el("div", { class: "card" }, groundPlot(`map of loops, ${name}`, [...xs, ...onMap.map(line => place(line).x)], [...zs, ...onMap.map(line => place(line).y)], [
        dots("recognized", found.filter(line => line.position).map(ground), kCorrect, 2.5), dots("scans", placed.map(ground), kPath, 1.2),
        joined("recognized", onMap.flatMap(line => [ground(line), place(line), { x: NaN, y: NaN }]), kCorrect + "80"), joined("scans", pathOf(xs, zs), kPath + "80", 1.4)], label)), el("div", { class: "card" }, ...raisedPlot(`raised map of loops, ${name}`, xs, zs, [["recognized", kCorrect, links]])))
        : el("p", { class: "soft" }, "The scans have no poses: there is no map."),
      found.length ? el("div", { class: "grid" }, el("div", { class: "card" }, matrix), el("div", { class: "card" }, scores)) : el("p", {}, "No loop was detected."));
  }

  /** Lines of about `letters`, broken between the steps of a perturbation. */
  function folded(name, letters = 32) {
    const lines = [];
    for (const step of name.split("+")) {
      const last = lines.length - 1;
      if (last >= 0 && lines[last].length + step.length < letters) lines[last] += "+" + step;
      else lines.push(last >= 0 ? "+" + step : step);
    }
    return lines;
  }
  /** `data` of a run: numbers, or [from, to]. */
  function perturbationPlot(name, runs, title, data, range, tooltip, line) {
    const rows = tasksOf(runs[0]), mark = { id: "mark", afterDatasetsDraw: chart => {
      const x = chart.scales.x.getPixelForValue(line), { top, bottom } = chart.chartArea, context = chart.ctx;
      context.save();
      context.strokeStyle = css("--text");
      context.setLineDash([5, 4]);
      context.beginPath();
      context.moveTo(x, top);
      context.lineTo(x, bottom);
      context.stroke();
      context.restore();
    } };
    const datasets = runs.map((run, i) => ({ label: run.title, data: tasksOf(run).map(data), borderColor: kColors[i % kColors.length],
      backgroundColor: kColors[i % kColors.length] + "cc", minBarLength: 2 }));
    return plot(name, { type: "bar", data: { labels: rows.map(row => folded(row.protocol)), datasets }, plugins: line === undefined ? [] : [mark], options: {
      indexAxis: "y", parsing: true, normalized: false, scales: { x: axis(title, range), y: { type: "category", ticks: { autoSkip: false, font: { size: 11 } } } },
      plugins: { tooltip: { callbacks: { title: items => items.length ? rows[items[0].dataIndex].protocol : "",
        label: item => `${item.dataset.label}: ${tooltip(tasksOf(runs[item.datasetIndex])[item.dataIndex])}` } } } } }, .8);
  }
  const tasksOf = run => list(run.tasks).map(task => task.metrics).filter(metrics => metrics.self !== undefined);
  /** Runs of perturbed queries; runs with equal queries and stored scans stand side by side. */
  function perturbedRuns() {
    const groups = new Map();
    for (const run of list(page.runs)) if (tasksOf(run).length) {
      const { seed, queries, distractors } = run.configuration || {}, tasks = list(run.tasks);
      const key = JSON.stringify([run.info.data, run.info.sequence, seed, queries, distractors, tasks.map(({ metrics: m }) =>
        [m.protocol, m.n_queries, m.n_positives, m.distance, m.radius_m, m.negative_radius_m, m.exclusion, m.query_case === "both"])]);
      if (!groups.has(key)) groups.set(key, []);
      groups.get(key).push(run);
    }
    return [...groups.values()];
  }
  function perturbedSection(runs, index) {
    const rows = tasksOf(runs[0]), first = rows[0], info = runs[0].info, all = runs.flatMap(tasksOf);
    const hasNeighbors = all.some(row => row.n_positives), hasRatio = all.some(row => row.ratio_median !== undefined);
    const of = (part, whole) => whole ? `${part || 0}/${whole}` : "", share = (part, whole) => whole ? 100 * (part || 0) / whole : null;
    const toned = (text, good, fair) => text ? el("span", { class: good ? "good" : fair ? "warn" : "bad" }, text) : "";
    const found = (part, whole) => toned(of(part, whole), (part || 0) === whole, (part || 0) >= .9 * whole);
    const ratio = value => toned(number(value, 2), value >= 1, value >= .95);
    const most = all.reduce((high, row) => Math.max(high, row.ratio_median || 0), 1.3);
    const data = [info.data.split("/").filter(Boolean).pop(), info.sequence].filter(Boolean).join(" "), name = `perturbed, ${data}`;
    return el("section", { id: `perturbed${index + 1}` }, el("h2", {}, `Perturbed scans: ${data}`),
      el("p", {}, `${first.n_queries || 0} scans were perturbed and each compared with ${list(runs[0].tasks[0].stored).length} unperturbed ones of the drive. ` +
        `Self: the best match is the original. Neighbor: the best match is within ${first.radius_m} m (${first.distance}), without the original${first.exclusion === "none" ? "" : ` and scans within ${first.exclusion}`}. ` +
        `Ratio: similarity of the best such scan over that of the best scan of another place${first.negative_radius_m ? `, beyond ${first.negative_radius_m} m` : ""}: median and minimum.`),
      el("div", { class: "grid" },
        el("div", { class: "card" }, hasNeighbors
          ? perturbationPlot(`found, ${name}`, runs, "neighbors found [%]", row => share(row.neighbor, row.n_positives), { min: 0, max: 100 }, row => of(row.neighbor, row.n_positives))
          : perturbationPlot(`found, ${name}`, runs, "originals found [%]", row => share(row.self, row.n_queries), { min: 0, max: 100 }, row => of(row.self, row.n_queries))),
        hasRatio ? el("div", { class: "card" }, perturbationPlot(`ratio, ${name}`, runs, "ratio, minimum to median; below 1 another place is more similar",
          row => row.ratio_median === undefined ? null : [row.ratio_min, row.ratio_median], { min: 0, max: Math.min(4, 1.05 * most) },
          row => `median ${number(row.ratio_median, 2)}, minimum ${number(row.ratio_min, 2)}`, 1)) : null),
      table([["perturbation"], ...runs.flatMap(run => [[`${run.title}: self`, "n"], ["neighbor", "n"], ["recall@1", "n"], ["AP", "n"], ["ratio", "n"], ["minimum", "n"]])],
        rows.map((row, i) => [row.protocol, ...runs.flatMap(run => {
          const cell = tasksOf(run)[i];
          return [found(cell.self, cell.n_queries), found(cell.neighbor, cell.n_positives), number(cell.recall_at_1), number(cell.average_precision), ratio(cell.ratio_median), ratio(cell.ratio_min)];
        })])));
  }
  function summarySection() {
    const spread = value => value === undefined ? "" : value.deviation === undefined ? number(value.mean, 4) : `${number(value.mean, 4)} ± ${number(value.deviation, 4)}`;
    const rows = list(page.summary).filter(row => row.runs > 1);
    return rows.length ? el("section", { id: "summary" }, el("h2", {}, "Mean and standard deviation"),
      table([["task"], ["sequence"], ["feature"], ["settings"], ["runs", "n"], ...kMetrics.map(([, title]) => [title, "n"])],
        rows.map(row => [row.protocol, row.sequence || "", row.feature || "", row.settings || "", String(row.runs), ...kMetrics.map(([key]) => spread(row[key]))]))) : "";
  }

  function profileSection(profile, index) {
    const layers = list(profile.layers).filter(layer => layer.ms && layer.ms.median), limits = profile.limits, name = profile.net || profile.prototxt;
    const bandwidths = list(limits && limits.bandwidths), memory = bandwidths[bandwidths.length - 1], changes = new Map();
    if (profile.baseline) list(profile.baseline.layers).forEach((change, i) => changes.set(profile.layers[i], change));
    const share = value => Number.isFinite(value) ? number(100 * value, 1) : "", gain = layer => layer.best_ms === undefined ? undefined : Math.max(0, layer.ms.median - layer.best_ms);
    const multiplies = layer => (layer.peak_share || 0) > (layer.memory_share || 0), bytes = layer => (layer.read_bytes || 0) + (layer.written_bytes || 0);
    const label = layer => [`${layer.name}: ${layer.kernel}`, `${number(layer.ms.median)} ms` + (layer.best_ms === undefined ? "" : `, at best ${number(layer.best_ms)} ms`),
      ...(layer.peak_share === undefined ? [] : [`${share(layer.peak_share)} % of the peak`]), ...(layer.memory_share === undefined ? [] : [`${share(layer.memory_share)} % of the bandwidth`])];
    const bar = (text, color, value) => ({ label: text, data: layers.map(value), borderColor: color, backgroundColor: color + "cc" });
    const bars = plot(`layers, ${name}`, { type: "bar", data: { labels: layers.map(layer => layer.name), datasets: !limits ? [bar("median", kPath, layer => layer.ms.median)] : [
      bar("at best, by the peak", kColors[0], layer => multiplies(layer) ? layer.best_ms : 0), bar("at best, by the bandwidth", kColors[4], layer => multiplies(layer) ? 0 : layer.best_ms || 0),
      bar("beyond the limits", kPath, gain)] }, options: { indexAxis: "y", parsing: true, normalized: false,
      scales: { x: axis("median [ms]", { min: 0, stacked: true }), y: { type: "category", stacked: true, ticks: { autoSkip: false, font: { size: 11 } } } },
      plugins: { tooltip: { callbacks: { title: () => "", label: item => label(layers[item.dataIndex]) } } } } }, Math.max(.2, Math.min(4, Math.min(1200, innerWidth) / (60 + 20 * layers.length))));
    // Both axes are logarithmic, because a bandwidth is then a straight line.
    function roofline() {
      const multiplying = layers.filter(layer => layer.multiplications), point = layer => ({ x: 2 * layer.multiplications / bytes(layer), y: 2 * layer.multiplications / layer.ms.median / 1e6, layer });
      const xs = multiplying.map(layer => point(layer).x), low = Math.min(1, ...xs) / 2, high = Math.max(100, ...xs) * 2, peak = Math.max(limits.float32_gflops, profile.precision === "bf16" ? limits.bf16_gflops || 0 : 0);
      const roof = (text, color, points, dash) => ({ label: text, data: points, showLine: true, borderColor: color, borderWidth: 1.6, borderDash: dash, pointRadius: 0, pointHitRadius: 0 });
      const slope = (text, rate, color) => roof(`${text}, ${number(rate, 1)} GB/s`, color, [{ x: low, y: low * rate }, { x: Math.min(high, peak / rate), y: Math.min(high * rate, peak) }]);
      const level = (text, gflops, dash) => roof(`${text}, ${number(gflops, 1)} GFLOP/s`, kColors[0], [{ x: low, y: gflops }, { x: high, y: gflops }], dash);
      const nearest = bandwidths.reduce((most, bandwidth) => Math.max(most, bandwidth.read, bandwidth.copied), 0);
      const roofs = [level("float32", limits.float32_gflops), ...(profile.precision === "bf16" && limits.bf16_gflops ? [level("bfloat16", limits.bf16_gflops, [6, 3])] : []),
        slope("memory", memory.read, kColors[4]), slope("nearest cache", nearest, kColors[2])];
      // Names of points, the slowest first, where they do not overlap.
      const names = { id: "names", afterDatasetsDraw: chart => {
        const drawn = [], context = chart.ctx, points = chart.getDatasetMeta(0).data, order = multiplying.map((layer, i) => i).sort((a, b) => multiplying[b].ms.median - multiplying[a].ms.median);
        context.save();
        context.font = "11px sans-serif";
        context.fillStyle = css("--text");
        for (const i of chart.isDatasetVisible(0) ? order : []) {
          const text = multiplying[i].name, { x, y } = points[i], width = context.measureText(text).width, left = x + 6 + width > chart.chartArea.right ? x - 6 - width : x + 6;
          if (drawn.some(box => left < box.right && box.left < left + width && Math.abs(y - box.y) < 12)) continue;
          drawn.push({ left, right: left + width, y });
          context.fillText(text, left, y + 4);
        }
        context.restore();
      } };
      return multiplying.length ? plot(`roofline, ${name}`, { type: "scatter", data: { datasets: [{ ...dots("layers", multiplying.map(point), kColors[1], 4), pointHitRadius: 8 }, ...roofs] }, plugins: [names], options: {
        scales: { x: axis("operations for each byte moved", { type: "logarithmic", min: low, max: high }), y: axis("GFLOP/s multiplied", { type: "logarithmic" }) },
        plugins: { tooltip: { filter: item => item.raw.layer, callbacks: { label: item => label(item.raw.layer) } } } } }, 1.35) : el("p", { class: "soft" }, "No layer multiplies.");
    }
    const verdict = change => el("span", { class: change.verdict === "faster" ? "good" : change.verdict === "slower" ? "bad" : "soft" },
      Number.isFinite(change.change ?? 0) && change.low !== undefined ? `${change.verdict}: ${share(change.change || 0)} [${share(change.low)}, ${share(change.high)}] %` : change.verdict || "");
    const against = profile.baseline;
    return el("section", { id: `profile${index + 1}` }, el("h2", {}, `Layers of ${name}`),
      el("p", {}, `The whole takes ${number(profile.total_ms.median, 3)} ms (median of ${profile.passes} passes, ${number(profile.total_ms.low, 3)} to ${number(profile.total_ms.high, 3)} with ${number(Math.min(99.9, 100 * profile.total_ms.confidence), 1)} % confidence) on ${profile.threads} thread${profile.threads === 1 ? "" : "s"}, kernels: ${profile.simd}. ` +
        (limits ? `Roofline bound of all layers: ${number(profile.best_ms || 0, 3)} ms, ${share((profile.best_ms || 0) / profile.layer_sum_ms.median)} % of their sum.`
          : `The machine was busy: ${profile.busy}. Its limits are unknown.`)),
      against ? el("p", {}, `Against ${against.file} (${number(against.whole.before_ms, 3)} ms): `, verdict(against.whole)) : null,
      el("div", { class: "card" }, bars), limits ? el("div", { class: "card map" }, roofline()) : null,
      table([["layer"], ["type"], ["kernel"], ["output"], ["MMACs", "n"], ["multiplied", "n"], ["MiB moved", "n"], ["median ms", "n"], ["from", "n"], ["to", "n"], ["GFLOP/s", "n"], ["peak %", "n"], ["memory %", "n"], ["gain ms", "n"],
        ...(against ? [["before ms", "n"], ["verdict"]] : [])],
        layers.map(layer => [layer.name, layer.type, layer.kernel, list(layer.output_shape).join("x"), number((layer.macs || 0) / 1e6, 1), layer.macs ? `${share((layer.multiplications || 0) / layer.macs)} %` : "",
          number(bytes(layer) / 1048576, 2), number(layer.ms.median), number(layer.ms.low), number(layer.ms.high), number(layer.gflops, 1), share(layer.peak_share), share(layer.memory_share), number(gain(layer)),
          ...(against ? [number(changes.get(layer).before_ms), verdict(changes.get(layer))] : [])])),
      el("p", { class: "soft" }, "GFLOP/s counts the multiplications of the definition; peak % those that the kernel does, which is fewer by Winograd's algorithm and where a gray input is one channel."));
  }

  const experiments = list(page.experiments), runs = list(page.runs), loops = list(page.loops), perturbed = perturbedRuns(), profiles = list(page.profiles);
  // A single curve is with its run.
  const overviewed = runs.length > perturbed.flat().length ? runs.length > 1 || list(runs[0].tasks).length > 1 : !(loops.length || perturbed.length || profiles.length);
  document.title = page.title || "revisit";
  root.append(
    el("header", {}, el("h1", {}, page.title || ""), el("p", { class: "soft" }, `revisit ${page.version}, ${page.made}`)),
    list(page.warnings).length ? el("div", {}, page.warnings.map(warning => el("p", { class: "note" }, warning))) : "",
    el("nav", {}, experiments.map(experiment => el("a", { href: "#" + experiment.name }, experiment.title)),
      perturbed.length ? el("a", { href: "#perturbed1" }, "Perturbed scans") : null, runs.length ? el("a", { href: "#runs" }, "Runs") : null),
    ...profiles.map(profileSection), ...loops.map(loopSection), experiments.length || overviewed ? overview() : "", summarySection(), ...perturbed.map(perturbedSection), ...experiments.map(experimentSection));
  if (runs.length) root.append(el("section", { id: "runs" }, el("h2", {}, `Runs (${runs.length})`), ...runs.map((run, i) => runSection(run, i, runs.length === 1))));
  root.append(commandBox(page.command));

  if (page.reload_seconds) setTimeout(() => location.reload(), 1000 * page.reload_seconds);

  function restyle() {
    for (const chart of charts) { theme(chart.options); chart.update("none"); }
  }
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", restyle);
  addEventListener("beforeprint", () => { restyle(); for (const chart of charts) chart.resize(); });
  addEventListener("afterprint", () => { restyle(); for (const chart of charts) chart.resize(); });
})();
