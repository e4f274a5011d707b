// What is known of one pixel.

/** Tell what is known of a pixel, in numbers and words. */
function tell(viewer, i) {
  const { pair } = viewer;
  viewer.told = i;
  const [x, y] = pair.place(i);
  viewer.find(".place").textContent = `pixel ${x}, ${y}`;
  const badge = viewer.find(".badge");
  badge.textContent = pair.status ? VERDICTS[pair.status[i]] : "";
  badge.className = `badge ${badge.textContent}`;
  const row = (body, cells) => {
    const line = body.insertRow();
    cells.forEach((text, k) => {
      const cell = line.insertCell();
      cell.textContent = text;
      if (k) cell.className = "number";
    });
  };
  const [values, errors] = [viewer.find(".values"), viewer.find(".errors")];
  values.replaceChildren();
  errors.replaceChildren();
  ["red", "green", "blue"].forEach((name, c) => {
    row(values, [name, digits(pair.a[c][i], 9), digits(pair.exact(i, c), 10)]);
    const bound = pair.bound.length ? [digits(pair.bound[c][i], 2)] : [];
    row(errors, [name, digits(pair.error(i, c), 3), brief(pair.ulps(i, c)), ...bound]);
  });
  viewer.find(".told").replaceChildren(...prose(pair.told[`${x},${y}`] ?? ""));
  const facts = viewer.find(".facts");
  facts.replaceChildren();
  const fact = (name, text) => {
    const [term, description] = [document.createElement("dt"), document.createElement("dd")];
    term.textContent = name;
    description.textContent = text;
    facts.append(term, description);
  };
  for (const [name, { plane, texts }] of Object.entries(pair.labels)) fact(name, texts[plane[i]]);
  for (const [name, plane] of Object.entries(pair.numbers)) fact(name, String(plane[i]));
}

/** Show the rays of a chosen pixel, where the page holds them. */
function explain(viewer, i) {
  const place = i === null ? "" : viewer.pair.place(i).join(",");
  const explanation = viewer.pair.explained[place];
  const section = viewer.find(".rays");
  section.hidden = explanation === undefined;
  viewer.find(".rays h3").textContent = `The rays of pixel ${place.replace(",", ", ")}`;
  viewer.find(".rays div").innerHTML = explanation ?? ""; // escaped where it was made; nothing in it may run
}

/** A text, with what stands in `backticks` as a name. */
function prose(text) {
  return text.split(/`([^`]*)`/).map((part, k) => {
    const node = document.createElement(k % 2 ? "code" : "span");
    node.textContent = part;
    return node;
  });
}

/** A number with so many significant digits, all of them written, so that columns align. */
function digits(x, count) {
  if (!Number.isFinite(x)) return brief(x);
  const size = Math.abs(x);
  const text = x === 0 ? "0" : size >= 1e-4 && size < 1e6 ? x.toPrecision(count) : x.toExponential(count - 1);
  return text.replaceAll("-", "−");
}
