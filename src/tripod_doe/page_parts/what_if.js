// What if: evaluates the surrogate of a study as its factors are moved, without any server.
(function () {
  "use strict";
  var SVG = "http://www.w3.org/2000/svg", ANGLES = 120, SHOWN = 3;

  function bytes(text) {
    var raw = atob(text), data = new Uint8Array(raw.length);
    for (var i = 0; i < raw.length; i++) data[i] = raw.charCodeAt(i);
    return data.buffer;
  }
  function doubles(text) { return new Float64Array(bytes(text)); }
  function singles(text) { return new Float32Array(bytes(text)); }

  // The surrogate: inputs -> components, as analyses/surrogate/learner.py has it.
  function Surrogate(given) {
    var width = given.inputs.length, count = given.components, powers = new Int8Array(bytes(given.exponents));
    var coefficients = doubles(given.coefficients), centres = doubles(given.centres), weights = doubles(given.weights);
    var lengths = doubles(given.lengths), terms = powers.length / width, points = centres.length / width;
    var products = [], value = new Float64Array(terms), smooth = [], plain = [];
    for (var t = 0; t < terms; t++) {
      var product = [];
      for (var i = 0; i < width; i++) for (var p = 0; p < powers[t * width + i]; p++) product.push(i);
      products.push(product);
    }
    for (var c = 0; c < count; c++) {
      smooth.push(weights.subarray(c * points, (c + 1) * points).some(function (w) { return w !== 0; }));
      plain.push(!coefficients.subarray(c * terms + 1, (c + 1) * terms).some(function (w) { return w !== 0; }));
    }
    this.component = function (place, c) {
      var sum = coefficients[c * terms];
      if (!plain[c]) for (var t = 1; t < terms; t++) sum += coefficients[c * terms + t] * value[t];
      if (!smooth[c]) return sum;
      for (var n = 0; n < points; n++) {
        var square = 0;
        for (var i = 0; i < width; i++) {
          var gap = (place[i] - centres[n * width + i]) / lengths[c * width + i];
          square += gap * gap;
        }
        sum += weights[c * points + n] * Math.exp(-0.5 * square);
      }
      return sum;
    };
    this.predict = function (place, chosen) {
      for (var t = 0; t < terms; t++) {
        value[t] = 1;
        for (var i = 0; i < products[t].length; i++) value[t] *= place[products[t][i]];
      }
      var found = {}, self = this;
      chosen.forEach(function (c) { found[c] = self.component(place, c); });
      return found;
    };
  }

  function encode(given, values) {
    return given.inputs.map(function (input) {
      var value = values[input.factor];
      if ("word" in input) return Number(value === input.word);
      return input.sign ? Math.sign(value) : (value - input.middle) / input.half;
    });
  }
  // Zero where the outputs that vanish are zero.
  function envelope(given, place) {
    return given.zeros.reduce(function (product, part) {
      var size = Math.abs(place[part[0]] * part[2] + part[1]);
      return size < 1e-12 ? 0 : product * size * (1 + part[3]) / (size + part[3]);
    }, 1);
  }
  function nearest(places, place, count) {
    var width = place.length, gaps = [];
    for (var n = 0; n < places.length / width; n++) {
      var square = 0;
      for (var i = 0; i < width; i++) square += Math.pow(place[i] - places[n * width + i], 2);
      gaps.push([square, n]);
    }
    gaps.sort(function (a, b) { return a[0] - b[0] || a[1] - b[1]; });
    return gaps.slice(0, count).map(function (pair) { return pair[1]; });
  }
  // Whether a place is farther from the mean of the computed points than each of them.
  function beyond(reach, place) {
    var middle = doubles(reach.middle), inverse = doubles(reach.inverse), gap = place.map(function (x, i) { return x - middle[i]; });
    return gap.reduce(function (sum, x, i) {
      return gap.reduce(function (part, y, j) { return part + x * y * inverse[i * gap.length + j]; }, sum);
    }, 0) > reach.limit;
  }
  function rms(values, rows) {
    return Math.sqrt(rows.reduce(function (sum, n) { return sum + values[n] * values[n]; }, 0) / rows.length);
  }
  function amount(quantity, found) {
    if (quantity.wraps) return 180 - ((180 - found[quantity.parts[0]]) % 360 + 360) % 360;
    return quantity.parts.length === 1 ? found[quantity.parts[0]] : Math.hypot(found[quantity.parts[0]], found[quantity.parts[1]]);
  }
  function text(value, digits) {
    return Number(value.toPrecision(digits || 3)).toString().replace("-", "\u2212");
  }
  function element(parent, name, attributes, words) {
    var made = name === "tr" || name === "td" || name === "th" ? document.createElement(name) : document.createElementNS(SVG, name);
    Object.keys(attributes || {}).forEach(function (key) { made.setAttribute(key, attributes[key]); });
    if (words !== undefined) made.textContent = words;
    parent.appendChild(made);
    return made;
  }

  function begin(section) {
    var given = JSON.parse(section.querySelector("script[type='application/json']").textContent);
    var surrogate = new Surrogate(given), places = doubles(given.places), names = Object.keys(given.factors), values = {};
    names.forEach(function (name) { values[name] = given.start[name]; });
    given.quantities.forEach(function (each) { each.values = singles(each.values); each.errors = singles(each.errors); });
    var parts = [].concat.apply([], given.quantities.map(function (each) { return each.parts; }));
    var every = Array.from({ length: given.components }, function (_, c) { return c; });
    var wave = given.wave && { values: singles(given.wave.values), errors: singles(given.wave.errors) };

    function predict(place, chosen) {
      var found = surrogate.predict(place, chosen), scale = envelope(given, place);
      chosen.forEach(function (c) { if (given.vanishes[c]) found[c] *= scale; });
      return found;
    }
    function state(values) {
      var place = encode(given, values), found = predict(place, wave ? every : parts), scale = envelope(given, place);
      var near = nearest(places, place, given.neighbours), outside = beyond(given.reach, place);
      return { place: place, components: found, near: near, scale: scale, outside: outside, quantities: given.quantities.map(function (each) {
        return { value: amount(each, found), half: each.vanishes && scale === 0 ? 0 : outside ? NaN : each.factor * rms(each.errors, near) * (each.vanishes ? scale : 1) };
      }) };
    }
    // Part of the variance by the scatter of each factor about these values, to first order.
    function contributions(values) {
      var squares = names.map(function (name) {
        var factor = given.factors[name];
        if (factor.words) return given.quantities.map(function () { return NaN; });
        var far = factor.levels.length ? Infinity : factor.std; // of few levels, from the first to the last one
        var low = Math.max(values[name] - far, factor.low), high = Math.min(values[name] + far, factor.high);
        var ends = [low, high].map(function (value) {
          var moved = Object.assign({}, values);
          moved[name] = value;
          return predict(encode(given, moved), parts);
        });
        return given.quantities.map(function (each) {
          return high > low ? Math.pow((amount(each, ends[1]) - amount(each, ends[0])) / (high - low) * factor.std, 2) : 0;
        });
      });
      return squares;
    }

    var shapes = wave && waveShapes(given.wave.orders), drawing = wave && waveDrawing();
    // Cosine of each order, then minus its sine, at each angle.
    function waveShapes(orders) {
      return Array.from({ length: ANGLES + 1 }, function (_, a) {
        var angle = 2 * Math.PI * a / ANGLES;
        return orders.map(function (order) { return Math.cos(order * angle); })
          .concat(orders.map(function (order) { return -Math.sin(order * angle); }));
      });
    }
    function force(shape, numbers, offset) {
      var sum = 0;
      for (var k = 0; k < shape.length; k++) sum += shape[k] * numbers[offset + k];
      return sum;
    }
    function waveDrawing() {
      var svg = section.querySelector("svg.wave"), top = 1.08 * given.wave.largest;
      function x(angle) { return 46 + 430 * angle / ANGLES; }
      function y(force) { return 120 - 104 * force / top; }
      [-1, -0.5, 0, 0.5, 1].forEach(function (level) {
        var force = Number((level * given.wave.largest).toPrecision(1));
        element(svg, "line", { x1: 46, x2: 476, y1: y(force), y2: y(force), "class": "grid" });
        element(svg, "text", { x: 40, y: y(force) + 4, "text-anchor": "end" }, text(force));
      });
      [0, 90, 180, 270, 360].forEach(function (degrees) {
        element(svg, "text", { x: x(degrees * ANGLES / 360), y: 244, "text-anchor": "middle" }, degrees + "°");
      });
      var band = element(svg, "path", { "class": "band" }), near = element(svg, "path", { "class": "near" });
      var line = element(svg, "path", { "class": "line" });
      return function (now) {
        var upper = [], lower = [], middle = [], computed = [], count = given.wave.orders.length * 2, first = now.near[0];
        shapes.forEach(function (shape, a) {
          var predicted = force(shape, now.components, 0), known = force(shape, wave.values, first * count);
          var square = now.near.reduce(function (sum, n) { return sum + Math.pow(force(shape, wave.errors, n * count), 2); }, 0);
          var half = now.outside ? 0 : given.wave.factor * Math.sqrt(square / now.near.length) * (given.vanishes[0] ? now.scale : 1), place = x(a).toFixed(1) + ",";
          middle.push(place + y(predicted).toFixed(1));
          computed.push(place + y(known).toFixed(1));
          upper.push(place + y(predicted + half).toFixed(1));
          lower.unshift(place + y(predicted - half).toFixed(1));
        });
        band.setAttribute("d", "M" + upper.concat(lower).join("L") + "Z");
        line.setAttribute("d", "M" + middle.join("L"));
        near.setAttribute("d", "M" + computed.join("L"));
      };
    }

    var bars = section.querySelector("svg.bars"), step = 444 / given.quantities.length;
    var drawn = given.quantities.map(function (each, at) {
      var left = 46 + step * at, label = each.label.replace(/ order$/, "");
      element(bars, "text", { x: left + step / 2, y: 224, "text-anchor": "middle" }, label);
      return {
        bar: element(bars, "rect", { x: left + 0.2 * step, width: 0.6 * step, "class": "bar" }),
        band: element(bars, "rect", { x: left + 0.32 * step, width: 0.36 * step, "class": "error" }),
        number: element(bars, "text", { x: left + step / 2, "text-anchor": "middle", "class": "number" })
      };
    });
    function height(each, value) { return 184 * Math.max(-1, Math.min(value / (1.1 * each.largest), 1)); }
    function drawBars(now) {
      given.quantities.forEach(function (each, at) {
        var found = now.quantities[at], half = found.half || 0, top = 204 - height(each, Math.abs(found.value));
        drawn[at].bar.setAttribute("y", top);
        drawn[at].bar.setAttribute("height", Math.max(204 - top, 0.5));
        drawn[at].band.setAttribute("y", 204 - height(each, Math.abs(found.value) + half));
        drawn[at].band.setAttribute("height", Math.max(2 * height(each, half), 1));
        drawn[at].number.setAttribute("y", Math.max(204 - height(each, Math.abs(found.value) + half) - 5, 12));
        drawn[at].number.textContent = text(found.value);
      });
    }
    function fill(selector, rows) {
      var body = section.querySelector(selector);
      body.textContent = "";
      rows.forEach(function (cells) {
        var row = element(body, "tr");
        cells.forEach(function (cell, at) { element(row, at ? "td" : "th", at ? { "class": "value" } : {}, cell); });
      });
    }
    function tables(now) {
      fill("table.answers tbody", given.quantities.map(function (each, at) {
        var found = now.quantities[at];
        return [each.label, text(found.value, 4) + (isNaN(found.half) ? " (outside of the points)" : " ± " + text(found.half, 2)), each.unit];
      }));
      var squares = contributions(values);
      var sums = given.quantities.map(function (_, at) {
        return squares.reduce(function (sum, row) { return sum + (row[at] || 0); }, 0);
      });
      fill("table.scatter tbody", names.map(function (name, row) {
        return [given.factors[name].label].concat(squares[row].map(function (square, at) {
          return isNaN(square) ? "\u2013" : sums[at] > 0 ? Math.round(100 * square / sums[at]) + " %" : "0 %";
        }));
      }).concat([["standard deviation"].concat(sums.map(function (sum, at) {
        return text(Math.sqrt(sum)) + (given.quantities[at].unit ? " " + given.quantities[at].unit : "");
      }))]));
      fill("table.nearest tbody", now.near.slice(0, SHOWN).map(function (n) {
        return [String(n)].concat(names.map(function (name) { return decoded(name, n); }),
          given.quantities.map(function (each) { return text(each.values[n], 4); }));
      }));
    }
    function decoded(name, n) {
      var word = given.factors[name].words && given.factors[name].words[0], value = null;
      given.inputs.forEach(function (input, at) {
        if (input.factor !== name || input.sign) return;
        var place = places[n * given.inputs.length + at];
        if ("word" in input) word = place === 1 ? input.word : word;
        else value = text(place * input.half + input.middle, 4);
      });
      return value === null ? word : value;
    }
    function move() {
      var start = performance.now(), now = state(values);
      if (drawing) drawing(now);
      drawBars(now);
      tables(now);
      section.dataset.milliseconds = String(performance.now() - start);
    }
    section.querySelectorAll("[data-factor]").forEach(function (control) {
      var name = control.dataset.factor, shown = control.parentNode.querySelector("output");
      control.addEventListener("input", function () {
        values[name] = given.factors[name].words ? control.value : Number(control.value);
        if (shown) shown.textContent = text(values[name], 4);
        move();
      });
    });
    section.whatIf = { given: given, predict: function (values) { return predict(encode(given, values), every); }, state: state };
    section.classList.add("moves");
    move();
  }
  document.querySelectorAll("section.what-if").forEach(begin);
})();
